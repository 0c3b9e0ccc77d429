"""The worked example: what 200 s of motion do to the energy of a released pendulum."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.registries import INTEGRATORS
from integ_gym.envs.settings import check_divides
from integ_gym.support.errors import InputError
from integ_gym.support.figures import write_figure
from integ_gym.support.terminal import compact_percent

from .figures import WINDOW, draw_drift

DT, DURATION = 0.05, 200.0
"""Of the pendulum: step and time, s."""

RELEASE = 0.5
"""Angle from hanging at the start, rad."""

CART_POLE_DT = 0.02
CART_POLE_TIMES = (10.0, 100.0, 1000.0)
"""When the cart-pole's energy is looked at, s."""

CART_POLE_INTEGRATORS = ("symplectic_euler", "stormer_verlet", "implicit_midpoint", "rk4")
"""Those whose energy lasts long enough to be worth following."""


@dataclass(frozen=True)
class Drift:
    """What happened to the energy of one plant.

    Attributes:
        setting: plant, start and step in one sentence.
        rows: one for each integrator, by the names of the columns.
    """

    setting: str
    rows: list[dict[str, str]]


def drift_example(directory: Path, dt: float | None = None) -> tuple[Drift, Drift, Path]:
    """Measure the drift of every integrator and draw it.

    Args:
        directory: where ``drift.png``, ``drift.svg`` and ``drift.pdf`` go.
        dt: step, s, of both plants; by default each has its own.

    Returns:
        The pendulum's drift, the cart-pole's, and the picture's path.

    Raises:
        ValueError: for a step that does not divide an oscillation.
    """
    if dt is not None:
        if not 0.0 < dt < math.inf:
            raise InputError(f"--dt must be a finite number above 0, got {dt}")
        check_divides("--dt", dt, "one oscillation", WINDOW)
    plant = Pendulum(gravity=9.81, mass_distribution="point")
    step = dt or DT
    changes = {}
    for name in INTEGRATORS.names():
        energy = numerics.energies(
            name, plant, (math.pi - RELEASE, 0.0), step, round(DURATION / step)
        )
        changes[name] = energy / energy[0] - 1.0
    picture = draw_drift(changes, step)
    path, *_ = write_figure(picture, directory / "drift")
    rows = [_row(name, change) for name, change in changes.items()]
    setting = (
        f"Pendulum, a point mass of {plant.mass:g} kg on a massless rod of {plant.length:g} m at "
        f"{plant.gravity:g} m/s^2: {_released(step)}"
    )
    return Drift(setting, rows), _cart_pole(dt or CART_POLE_DT), path


def _row(name: str, change: Any) -> dict[str, str]:
    return {
        "integrator": name,
        f"energy change at {DURATION:g} s": _signed(change[-1]),
        "largest change": compact_percent(float(np.abs(change).max()), 4),
    }


def _cart_pole(dt: float) -> Drift:
    plant = CartPole()
    start = (0.0, 0.0, math.pi - RELEASE, 0.0)
    steps = [round(time / dt) for time in CART_POLE_TIMES]
    rows = []
    for name in CART_POLE_INTEGRATORS:
        energy = numerics.energies(name, plant, start, dt, steps[-1])
        change = {
            f"energy change at {time:g} s": _signed(energy[k] / energy[0] - 1.0)
            for time, k in zip(CART_POLE_TIMES, steps, strict=True)
        }
        rows.append({"integrator": name, **change})
    setting = (
        f"Cart-pole, a cart of {plant.cart_mass:g} kg and a pole of {plant.mass:g} kg and "
        f"{2.0 * plant.length:g} m at {plant.gravity:g} m/s^2: {_released(dt)}"
    )
    return Drift(setting, rows)


def _released(dt: float) -> str:
    return f"released at rest {RELEASE:g} rad from hanging, no control, dt {dt:g} s"


def _signed(change: float) -> str:
    return compact_percent(float(change), 4, sign=True)
