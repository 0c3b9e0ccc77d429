"""The engines as subjects: every integrator of every installed one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from integ_gym.envs.numerics.fingerprint import DAMPING, damping_parameters
from integ_gym.envs.numerics.stepping import engine_of, one_step
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.system import PlantSystem
from integ_gym.eval.census.settable import Settable
from integ_gym.eval.census.subject import Statement, Subject

SETTINGS: tuple[tuple[Any, float, float], ...] = ((Pendulum(), 0.05, 2.0), (CartPole(), 0.02, 10.0))
"""Plant, step in seconds and largest control: those of Gymnasium's environments."""


def engine_subjects(engine: str, integrators: tuple[str, ...]) -> Iterator[Subject]:
    """The pendulum and the cart-pole of Gymnasium in an engine.

    Args:
        engine: a registered name.
        integrators: as the engine calls them.

    Raises:
        ModuleNotFoundError: if the engine is not installed.
    """
    for plant, dt, max_control in SETTINGS:
        damped = replace(plant, **dict.fromkeys(damping_parameters(plant), DAMPING))
        for integrator in integrators:
            method = f"{engine}/{integrator}"
            made = engine_of(method, PlantSystem(plant), dt)
            yield Subject(
                source=engine,
                name=integrator,
                version=made.version,
                published=False,
                plant=plant,
                stated=Statement(dt, map=getattr(made, "map", integrator), words=integrator),
                max_control=max_control,
                access=Settable(
                    one_step(method, plant, dt), damped=(damped, one_step(method, damped, dt))
                ),
                width=made.width,
            )
