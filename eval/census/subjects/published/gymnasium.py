"""Gymnasium's classic control environments."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import gymnasium
import numpy as np

from integ_gym.envs import CartPole, Components, Pendulum, join_state, numerics, split_state

from ..settable import Settable
from ..subject import Statement, Subject


class Gymnasium:
    """Reads parameters and state of ``env.unwrapped``; the state is set before each step."""

    title: ClassVar[str] = "Gymnasium"
    modules: ClassVar[tuple[str, ...]] = ("gymnasium",)
    install: ClassVar[str] = "pip install gymnasium"

    def subjects(self) -> Iterator[Subject]:
        """`Pendulum-v1` and `CartPole-v1`."""
        env: Any = gymnasium.make("Pendulum-v1").unwrapped
        yield Subject(
            source=self.title,
            name="Pendulum-v1",
            version=gymnasium.__version__,
            published=True,
            plant=Pendulum(mass=env.m, length=env.l, gravity=env.g),
            stated=Statement(env.dt, max_speed=env.max_speed),
            max_control=env.max_torque,
            access=Settable(_pendulum(env)),
            width=32,
            note="torques in float32, as its action space has them",
        )
        env = gymnasium.make("CartPole-v1").unwrapped
        yield Subject(
            source=self.title,
            name="CartPole-v1",
            version=gymnasium.__version__,
            published=True,
            plant=CartPole(
                cart_mass=env.masscart, mass=env.masspole, length=env.length, gravity=env.gravity
            ),
            stated=Statement(env.tau, map="explicit_euler", words=env.kinematics_integrator),
            max_control=env.force_mag,
            access=Settable(_cart_pole(env)),
            note="force_mag set to the force wanted",
        )


def _pendulum(env: Any) -> numerics.OneStep:
    env.reset(seed=0)

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        env.state = np.array([*q, *v])
        env.step(np.array([control], dtype=np.float32))
        return split_state(tuple(env.state.tolist()))

    return advanced


def _cart_pole(env: Any) -> numerics.OneStep:
    env.reset(seed=0)

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        env.state, env.steps_beyond_terminated = np.array(join_state(q, v)), None
        env.force_mag = abs(control)
        env.step(int(control > 0.0))
        return split_state(tuple(float(x) for x in env.state))

    return advanced
