"""The worked example: what 200 s of motion do to the energy of a released pendulum."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.registries import INTEGRATORS
from integ_gym.envs.settings import check_divides
from integ_gym.support.errors import InputError
from integ_gym.support.figures import line_style, write_figure
from integ_gym.support.terminal import compact_percent, step

from ..scheme_style import styles_of
from .figures import draw_grid, label_axes, windows
from .subject import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WINDOW: Final = 2.0
"""What the largest change is taken over, s: about one oscillation of the pendulum."""

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
    pendulum, cart_pole = Pendulum(gravity=9.81, mass_distribution="point"), CartPole()
    own, start = dt or DT, (math.pi - RELEASE, 0.0)
    energies = {
        name: numerics.energies(
            name, pendulum, (math.pi - RELEASE, 0.0), own, round(DURATION / own)
        )
        for name in INTEGRATORS.names()
    }
    changes = {name: energy / energy[0] - 1.0 for name, energy in energies.items()}
    path, *_ = write_figure(draw_drift(changes, own), directory / "drift")
    rows = [
        {
            "integrator": name,
            f"energy change at {DURATION:g} s": _percent(change[-1]),
            "largest change": compact_percent(float(np.abs(change).max()), 4),
        }
        for name, change in changes.items()
    ]
    setting = (
        f"Pendulum, a point mass of {pendulum.mass:g} kg on a massless rod of "
        f"{pendulum.length:g} m at {pendulum.gravity:g} m/s^2: {_release(own)}"
    )
    own = dt or CART_POLE_DT
    steps = {time: round(time / own) for time in CART_POLE_TIMES}
    slow_rows = []
    for name in CART_POLE_INTEGRATORS:
        energy = numerics.energies(name, cart_pole, (0.0, 0.0, *start), own, max(steps.values()))
        slow_rows.append({"integrator": name})
        for time, k in steps.items():
            change = energy[k] / energy[0] - 1.0
            slow_rows[-1][f"energy change at {time:g} s"] = _percent(change)
    slow_setting = (
        f"Cart-pole, a cart of {cart_pole.cart_mass:g} kg and a pole of {cart_pole.mass:g} kg and "
        f"{2.0 * cart_pole.length:g} m at {cart_pole.gravity:g} m/s^2: {_release(own)}"
    )
    return Drift(setting, rows), Drift(slow_setting, slow_rows), path


def _release(dt: float) -> str:
    return f"released at rest {RELEASE:g} rad from hanging, no control, dt {dt:g} s"


def _percent(change: float) -> str:
    return compact_percent(float(change), 4, sign=True)


def draw_drift(changes: Mapping[str, Array], dt: float) -> Figure:
    """The largest energy change within each oscillation, over time, and its value at the end.

    Args:
        changes: relative energy change at every step, by integrator.
        dt: step, s.
    """
    styles = styles_of(changes)
    heading = (
        "Energy drift of a released pendulum",
        f"point mass, 0.5 rad from hanging, dt = {step(dt)} s; largest change within each "
        f"{WINDOW:g} s; at the right, the change at the end",
    )
    figure, ((axes,),) = draw_grid(heading, (), (1, 1), (5.8, 3.9), right=2.4, legible=0.25)
    window = round(WINDOW / dt)
    for name, change in changes.items():
        envelope = 100.0 * windows(np.abs(change), window).max(axis=1)
        time = (np.arange(len(envelope)) + 0.5) * WINDOW
        style = styles[name]
        axes.semilogy(time, envelope, **line_style(style, 1.3))
        label = f"{name}: {compact_percent(float(change[-1]), 3, sign=True)}"
        axes.annotate(
            label, (time[-1], envelope[-1]), xytext=(8, 0), textcoords="offset points",
            size=8.5, color=style.colour, va="center", annotation_clip=False,
        )  # fmt: skip
    axes.set_xlim(0.0, len(change) * dt)
    label_axes(axes, "", "time, s", "|energy change|, %")
    return figure
