"""The worked example: what 200 s of a released pendulum do to its energy."""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.envs import INTEGRATORS, CartPole, Pendulum, numerics
from integ_gym.support import compact, write_figure

from .figures import draw_drift

DT, STEPS = 0.05, 4000
"""Of the pendulum: 200 s."""

RELEASE = 0.5
"""Angle from hanging at the start, rad."""

CART_POLE_DT = 0.02
CART_POLE_TIMES = (10.0, 100.0, 1000.0)
"""When the cart-pole's energy is looked at, s."""

CART_POLE_INTEGRATORS = ("symplectic_euler", "stormer_verlet", "implicit_midpoint", "rk4")
"""Those whose energy lasts long enough to be worth following."""


def drift_example(directory: Path) -> tuple[list[dict[str, str]], list[dict[str, str]], Path]:
    """Measure the drift of every integrator and draw it.

    Args:
        directory: where ``drift.png``, ``drift.svg`` and ``drift.pdf`` go.

    Returns:
        Rows of two tables, the pendulum's and the cart-pole's, and the picture's path.
    """
    plant = Pendulum(gravity=9.81, mass_distribution="point")
    start = (pi - RELEASE, 0.0)
    changes = {}
    for name in INTEGRATORS.names():
        energy = numerics.energies(name, plant, start, DT, STEPS)
        changes[name] = energy / energy[0] - 1.0
    picture = draw_drift(changes, DT)
    path, *_ = write_figure(picture, directory / "drift")
    return [_row(name, change) for name, change in changes.items()], _cart_pole(), path


def _row(name: str, change: Any) -> dict[str, str]:
    return {
        "integrator": name,
        "energy change at 200 s": f"{_signed(100.0 * change[-1])} %",
        "largest change": f"{compact(100.0 * float(np.abs(change).max()), 4)} %",
    }


def _cart_pole() -> list[dict[str, str]]:
    plant = CartPole()
    start = (0.0, 0.0, pi - RELEASE, 0.0)
    steps = [round(time / CART_POLE_DT) for time in CART_POLE_TIMES]
    rows = []
    for name in CART_POLE_INTEGRATORS:
        energy = numerics.energies(name, plant, start, CART_POLE_DT, steps[-1])
        change = {
            f"cart-pole, at {time:g} s": f"{_signed(100.0 * (energy[k] / energy[0] - 1.0))} %"
            for time, k in zip(CART_POLE_TIMES, steps, strict=True)
        }
        rows.append({"integrator": name, **change})
    return rows


def _signed(value: float) -> str:
    return compact(float(value), 4, True)
