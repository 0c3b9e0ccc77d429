"""Gymnasium's classic control environments."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.ops.ops import Components, join_state, split_state

from ..subjects import Subject
from .interface import Library


class Gymnasium(Library):
    """Reads parameters and state of ``env.unwrapped``; the state is set before each step."""

    title = "Gymnasium"
    package = "gymnasium"
    modules = ("gymnasium",)
    install = "pip install gymnasium"

    def subjects(self) -> Iterator[Subject]:
        """`Pendulum-v1` and `CartPole-v1`."""
        pendulum: Any = gymnasium.make("Pendulum-v1").unwrapped
        cart_pole: Any = gymnasium.make("CartPole-v1").unwrapped

        def turned(control: float) -> np.ndarray:
            return np.array([control], dtype=np.float32)

        def pushed(control: float) -> int:
            cart_pole.steps_beyond_terminated, cart_pole.force_mag = None, abs(control)
            return int(control > 0.0)

        note = "torques in float32, as its action space has them"
        step = _step(pendulum, turned)
        yield self.pendulum("Pendulum-v1", pendulum, pendulum.max_torque, step, note)
        yield self.cart_pole(
            "CartPole-v1", cart_pole, _step(cart_pole, pushed), cart_pole.kinematics_integrator,
            note="force_mag set to the force wanted",
        )  # fmt: skip


def _step(env: Any, action: Callable[[float], Any]) -> numerics.OneStep:
    """One control period under the action that stands for a control."""
    env.reset(seed=0)

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        env.state = np.array(join_state(q, v))
        env.step(action(control))
        return split_state(tuple(float(x) for x in env.state))

    return advanced
