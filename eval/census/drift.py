"""What a subject does to the energy of a free motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.mechanics import PlantSystem
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.interface import Plant, join_state

from .subjects.subject import State


@dataclass(frozen=True)
class Drift:
    """Energy of a free motion against that of the exact solution from the same start.

    Energies are relative to that at the start; zero is at rest hanging.

    Attributes:
        start: (q, v), SI units.
        duration: s.
        end: energy at the end less that of the exact solution; `inf` where the motion diverged.
        largest: largest magnitude of that difference at any instant of control.
        energies: at the instants of control.
        exact_energies: of the exact solution at the same instants.
    """

    start: State
    duration: float
    end: float
    largest: float
    energies: tuple[float, ...]
    exact_energies: tuple[float, ...]


def energy_drift(plant: Plant, states: Sequence[State], period: float) -> Drift:
    """Follow the energy of a free motion.

    Args:
        plant: what moves.
        states: at instants ``period`` seconds apart.
        period: s.
    """
    measured = _energies(plant, states)
    exact = _energies(plant, _exact(plant, states, period))
    difference = np.abs(measured - exact) / exact[0]
    worst = float(difference.max()) if np.isfinite(difference).all() else math.inf
    return Drift(
        start=states[0],
        duration=period * (len(states) - 1),
        end=float((measured[-1] - exact[-1]) / exact[0]) if worst < math.inf else math.inf,
        largest=worst,
        energies=tuple((measured / exact[0]).tolist()),
        exact_energies=tuple((exact / exact[0]).tolist()),
    )


def _exact(plant: Plant, states: Sequence[State], period: float) -> Sequence[State]:
    """The exact motion from the same start; without damping its energy is that of the start."""
    if not any(getattr(plant, name) for name in numerics.damping_parameters(plant)):
        return [states[0]] * len(states)
    motion = [states[0]]
    for _ in states[1:]:
        end = numerics.advance("reference", plant, join_state(*motion[-1]), period)
        motion.append((tuple(end[0::2]), tuple(end[1::2])))
    return motion


def _energies(plant: Plant, states: Sequence[State]) -> np.ndarray:
    system = PlantSystem(plant)
    return np.array([_energy(system, *state) for state in states], dtype=np.float64)


def _energy(system: PlantSystem, q: tuple[float, ...], v: tuple[float, ...]) -> float:
    try:
        return float(system.energy(SCALAR, q, v))
    except (ArithmeticError, ValueError):  # of a component that is not finite
        return math.nan
