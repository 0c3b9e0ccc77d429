"""Environments that are not what they say, for the census to find out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from integ_gym.envs.numerics.stepping import one_step
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.eval.census.subjects import Episode, Observed, Policy, Settable, Statement, Subject

PENDULUM = Pendulum()
SAID = Statement(0.05, map="symplectic_euler", words="semi-implicit Euler")


def subject(step: Any, stated: Statement = SAID, plant: Any = PENDULUM, **others: Any) -> Subject:
    """A subject that can be set and steps by ``step``."""
    given = {"max_control": 2.0, "access": Settable(step), **others}
    return Subject("planted", "Planted-v0", "1", True, plant, stated, **given)


def repeated(step: Any, count: int) -> Any:
    """``count`` steps as one."""

    def steps(q: Any, v: Any, control: float) -> Any:
        for _ in range(count):
            q, v = step(q, v, control)
        return q, v

    return steps


def drift_kick_drift(q: Any, v: Any, control: float) -> Any:
    """Position Verlet, 0.05 s: none of the known maps."""
    middle = (q[0] + 0.025 * v[0],)
    end = v[0] + 0.05 * PENDULUM.acceleration(SCALAR, middle, v, (control,))[0]
    return (middle[0] + 0.025 * end,), (end,)


def limited(limit: float, moves_by: str) -> Any:
    """Semi-implicit Euler, 0.05 s, that cuts its speed before or after the position moves."""

    def step(q: Any, v: Any, control: float) -> Any:
        raw = v[0] + 0.05 * PENDULUM.acceleration(SCALAR, q, v, (control,))[0]
        cut = max(-limit, min(raw, limit))
        return (q[0] + 0.05 * (cut if moves_by == "cut" else raw),), (cut,)

    return step


def dragged(q: Any, v: Any, control: float) -> Any:
    """Semi-implicit Euler, 0.05 s, with a drag above 5 rad/s."""
    (end,) = limited(1e9, "cut")(q, v, control)[1]
    end -= 0.01 * max(0.0, abs(end) - 5.0) * end
    return (q[0] + 0.05 * end,), (end,)


def watched(step: Any, stated: Statement = SAID) -> Subject:
    """A subject of which only episodes can be seen, that begin beside hanging, moving."""

    def watch(policy: Policy) -> list[Episode]:
        episodes = []
        for k in range(5):
            state = ((1.2 + 0.1 * k,), (0.3 * (k - 2),))
            episode = Episode([state], [])
            for i in range(200):
                control = {
                    "zero": 0.0,
                    "random": ((37 * i + 11 * k) % 41 - 20) / 10.0,
                    "driven": 2.0 if state[1][0] > 0.0 else -2.0,
                }[policy]
                state = step(*state, control)
                episode.controls.append(control)
                episode.states.append(state)
            episodes.append(episode)
        return episodes

    return subject(step, stated, access=Observed(watch))


class PlantedLibrary:
    """A library of one honest environment and one that takes another step than it says."""

    title = "planted"
    modules: tuple[str, ...] = ()
    install = "pip install planted"

    def subjects(self) -> Iterator[Subject]:
        """A pendulum and a cart-pole."""
        yield subject(one_step("symplectic_euler", PENDULUM, 0.05))
        plant = replace(CartPole(), damping=0.1)
        yield subject(one_step("rk4", plant, 0.01), Statement(0.02, map="rk4"), plant)


class BrokenLibrary(PlantedLibrary):
    """A library whose environments cannot be made."""

    title = "broken"

    def subjects(self) -> Iterator[Subject]:
        """None."""
        raise AttributeError("'Env' object has no attribute 'theta'")


class AbsentLibrary(PlantedLibrary):
    """A library that is not installed."""

    title = "absent"
    modules = ("no_such_module",)
    install = "pip install absent"
