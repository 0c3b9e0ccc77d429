"""What an integrator does to the energy of a free motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..arithmetic import SCALAR
from ..engines import NativeEngine
from ..mechanics import PlantSystem
from ..plants import Plant, split_state
from .stepping import Array, State

Kind = Literal["bounded", "linear", "exponential"]

WINDOWS = 10
"""Parts of the motion whose mean energies are compared."""

BOUNDED = 0.3
"""A drift below this share of the energy's ripple is none."""

ROUNDING = 1e-10
"""Changes below this share of the energy measure the arithmetic."""

DISTINCT = 0.1
"""|log energy ratio| below which linear and exponential growth are the same."""


@dataclass(frozen=True)
class EnergyGrowth:
    """How the energy of a free motion drifts.

    Attributes:
        kind: `bounded` where the drift of the mean energy stays below the energy's own ripple;
            `exponential` where log E follows time better than E does; `linear` otherwise, also
            where the two cannot yet be told apart (total change below 10 %).
        drift: change of the mean energy from the first to the last tenth of the motion, relative
            to the first; negative where energy is drained. `inf` where the motion diverged.
        largest: max |E − E₀| / E₀.
    """

    kind: Kind
    drift: float
    largest: float


def energies(
    integrator: str, plant: Plant, state: State, dt: float, steps: int, control: float = 0.0
) -> Array:
    """Energy after each step, J, shape (steps + 1,); NaN from where the arithmetic fails.

    Args:
        integrator: a registered name or ``"module:Class"``.
        plant: with numbers as parameters.
        state: start, shape (n,), in state order.
        dt: step, s.
        steps: how many.
        control: held throughout, in the plant's unit.
    """
    system = PlantSystem(plant)
    engine = NativeEngine(system, integrator, dt)
    q, v = split_state(tuple(float(x) for x in state))
    trace = np.full(steps + 1, np.nan)
    try:
        trace[0] = system.energy(SCALAR, q, v)
        for k in range(1, steps + 1):
            motion = engine.advance(SCALAR, q, v, ((control, 1),), None)
            q, v = motion.q, motion.v
            trace[k] = system.energy(SCALAR, q, v)
    except ArithmeticError:
        pass
    return trace


def energy_growth(energy: Array) -> EnergyGrowth:
    """Classify the energies of a free motion.

    Args:
        energy: J, equally spaced in time over some periods of the motion, shape (steps + 1,), as
            :func:`energies` gives them; the first one above zero.
    """
    largest = float(np.abs(energy / energy[0] - 1.0).max())
    if not np.isfinite(largest):
        return EnergyGrowth("exponential", np.inf, np.inf)
    windows = np.array_split(energy, WINDOWS)
    means = np.array([w.mean() for w in windows])
    ripple = float(np.median([np.ptp(w) for w in windows]))
    drift = float(means[-1] / means[0] - 1.0)
    if abs(means[-1] - means[0]) <= max(BOUNDED * ripple, ROUNDING * energy[0]):
        return EnergyGrowth("bounded", drift, largest)
    return EnergyGrowth("exponential" if _exponential(means) else "linear", drift, largest)


def _exponential(means: Array) -> bool:
    if means.min() <= 0.0 or abs(np.log(means[-1] / means[0])) < DISTINCT:
        return False
    time = np.arange(float(len(means)))
    return _misfit(time, np.log(means)) < _misfit(time, means)


def _misfit(time: Array, values: Array) -> float:
    """Residual of a straight line, as a share of the values' own spread."""
    line = np.polyval(np.polyfit(time, values, 1), time)
    return float(np.linalg.norm(values - line) / np.linalg.norm(values - values.mean()))
