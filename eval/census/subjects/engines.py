"""The engines as subjects: every integrator of every installed one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from integ_gym.envs import numerics
from integ_gym.envs.mechanics import PlantSystem
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum

from .settable import Settable
from .subject import Statement, Subject

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
        damped = replace(
            plant, **dict.fromkeys(numerics.damping_parameters(plant), numerics.DAMPING)
        )
        for integrator in integrators:
            method = f"{engine}/{integrator}"
            yield Subject(
                source=engine,
                name=integrator,
                published=False,
                plant=plant,
                max_control=max_control,
                access=Settable(
                    numerics.one_step(method, plant, dt),
                    damped=(damped, numerics.one_step(method, damped, dt)),
                ),
                **_told(method, integrator, plant, dt),
            )


def _told(method: str, integrator: str, plant: Any, dt: float) -> dict[str, Any]:
    """What an engine says of itself; it is let go."""
    made = numerics.engine_of(method, PlantSystem(plant), dt)
    stated = Statement(dt, map=getattr(made, "map", integrator), words=integrator)
    return {"version": made.version, "stated": stated, "width": made.width}
