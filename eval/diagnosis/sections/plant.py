"""The plant itself: whether its equations, its energy and its mass matrix belong together."""

from __future__ import annotations

from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.engines.stepping import PlantSystem
from integ_gym.envs.ops.ops import ARRAY, join_state, split_state
from integ_gym.envs.plants.interface import Plant

from ..bench import Array as Array
from ..lines import ANY, Diagnosis, Expectation, below, near

STATES = 32
"""Random states around rest at which the plant is asked."""

EXACT = 1e-8
"""A share that is rounding of differences."""

_SPREAD = 0.5
_RESISTANCE = 0.3


def diagnose_plant(diagnosis: Diagnosis) -> None:
    """Compare what the plant says of itself with differences of what it says elsewhere."""
    subject = diagnosis.subject
    names = subject.resistances("damping", "friction")
    plant = subject.varied(**dict.fromkeys(names, _RESISTANCE))
    states = states_around(subject.rest)
    _share(
        diagnosis, "rate of energy − power of the control + dissipation, by the largest of them",
        energy_defect(plant, states), "energy, accelerations and dissipation agree",
    )  # fmt: skip
    _share(
        diagnosis, "mass matrix × acceleration by a unit force − force",
        mass_defect(plant, states), "mass matrix and accelerations agree",
    )  # fmt: skip
    _constant(diagnosis, plant, states)
    if hasattr(plant, "jacobian"):
        _share(
            diagnosis, "Jacobian − differences of the accelerations, by the largest entry",
            jacobian_defect(plant, states), "Jacobian and accelerations agree",
        )  # fmt: skip
    left = (rest_energy(plant, subject.rest),)
    diagnosis.add(ANY, "energy at rest", left, "J", near(0.0, EXACT, left, "J"))


def states_around(rest: Array) -> Array:
    """Random states around a state of shape (n,), shape (STATES, n)."""
    spread = np.random.default_rng(0).uniform(-_SPREAD, _SPREAD, (STATES, len(rest)))
    states: Array = rest + spread
    return states


def _share(diagnosis: Diagnosis, quantity: str, share: float, why: str) -> None:
    diagnosis.add(ANY, quantity, (share,), "", below(EXACT, (share,), "", why))


def rest_energy(plant: Plant, rest: Array) -> float:
    """Energy of a rest state of shape (n,), J: zero by contract."""
    return float(plant.energy(ARRAY, *split_state(tuple(rest))))


def energy_defect(plant: Plant, states: Array, control: float = 1.0) -> float:
    """Largest |dE/dt − u q̇ + losses| by the largest of the terms, over states (lanes, n)."""
    q, v = split_state(tuple(states.T))
    system = PlantSystem(plant)
    acceleration, losses = system.rates(ARRAY, q, v, control)

    def energy(shift: Array) -> Array:
        """Along the motion, at times (times, 1), shape (times, lanes)."""
        moved_q = tuple(x + shift * y for x, y in zip(q, v, strict=True))
        moved_v = tuple(x + shift * y for x, y in zip(v, acceleration, strict=True))
        return np.asarray(system.energy(ARRAY, moved_q, moved_v))

    rate = numerics.jacobian(energy, np.zeros(1))[:, 0]
    power, lost = control * v[plant.actuated], sum(losses)
    terms = np.abs(np.stack(np.broadcast_arrays(rate, power, lost)))
    return float(np.abs(rate - power + lost).max() / terms.max())


def mass_defect(plant: Plant, states: Array) -> float:
    """Largest |M (a(F) − a(0)) − F| for unit forces F, over states (lanes, n)."""
    q, v = split_state(tuple(states.T))
    rows, free = plant.mass_matrix(ARRAY, q), plant.acceleration(ARRAY, q, v, (0.0,) * len(q))
    off = []
    for force in np.eye(len(q)):
        pushed = plant.acceleration(ARRAY, q, v, tuple(force))
        gained = [a - b for a, b in zip(pushed, free, strict=True)]
        for row, f in zip(rows, force, strict=True):
            off.append(sum(m * a for m, a in zip(row, gained, strict=True)) - f)
    return float(np.abs(off).max())


def jacobian_defect(plant: Any, states: Array) -> float:
    """Largest |Jacobian − differences| by the largest entry, over states (lanes, n)."""
    nothing = (0.0,) * len(plant.coordinates)

    def acceleration(points: Array) -> Array:
        q, v = split_state(tuple(points.T))
        columns = plant.acceleration(ARRAY, q, v, nothing)
        return np.stack([np.broadcast_to(x, len(points)) for x in columns], -1)

    def given(state: Array) -> Array:
        by_q, by_v = plant.jacobian(ARRAY, *split_state(tuple(state)), nothing)
        columns = join_state(tuple(zip(*by_q, strict=True)), tuple(zip(*by_v, strict=True)))
        return np.array(columns, dtype=np.float64).T

    differences = np.array([numerics.jacobian(acceleration, state) for state in states])
    jacobians = np.array([given(state) for state in states])
    return float(np.abs(jacobians - differences).max() / np.abs(differences).max())


def _constant(diagnosis: Diagnosis, plant: Plant, states: Array) -> None:
    """Whether M(q) changes, as `constant_mass_matrix` says."""
    q, _ = split_state(tuple(states.T))
    entries = [np.broadcast_to(x, STATES) for row in plant.mass_matrix(ARRAY, q) for x in row]
    change = float(np.ptp(np.array(entries), axis=1).max())
    constant = plant.constant_mass_matrix
    expectation = Expectation(
        f"{'0' if constant else 'some'}: declared {'constant' if constant else 'to depend on q'}",
        "exactly" if constant else "above 0",
        (change == 0.0) is constant,
    )
    quantity = "change of the mass matrix between configurations"
    diagnosis.add(ANY, quantity, (change,), "", expectation)
