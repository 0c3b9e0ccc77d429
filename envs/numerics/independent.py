"""A driven motion by SciPy: what integ-gym's own integrators and ledger are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from integ_gym.support.packages.extras import load

from ..arithmetic.ops import SCALAR
from ..mechanics.system import PlantSystem
from ..plants.interface import Plant, join_state, split_state
from .stepping import Array, State

TOLERANCE = 1e-13
"""Relative and absolute, of every inner step."""


@dataclass(frozen=True)
class IndependentMotion:
    """A motion at its control instants, from time 0.

    Attributes:
        states: in state order, SI units, shape (instants, n).
        energy: of the plant and its stops, J, shape (instants,).
        work: ∫ u q̇ dt of the control so far, J, shape (instants,).
        lost: work − change of energy so far, J, shape (instants,): what damping, friction and
            stops have taken out, whatever the plant says of its dissipation.
    """

    states: Array
    energy: Array
    work: Array
    lost: Array


def independent_motion(
    plant: Plant, state: State, controls: Sequence[float] | Array, control_period: float
) -> IndependentMotion:
    """Follow a plant under held controls with ``solve_ivp(method="DOP853")``.

    Neither an integrator nor the energy ledger of integ-gym takes part.

    Args:
        plant: with numbers as parameters.
        state: start, shape (n,), in state order.
        controls: one per control period, in the plant's unit.
        control_period: s.

    Raises:
        ModuleNotFoundError: without SciPy, with the command that installs it.
        ValueError: where SciPy cannot follow the motion.
    """
    solve = load("scipy.integrate", "report").solve_ivp
    system, n = PlantSystem(plant), len(state) // 2

    def slopes(_: float, y: Array, control: float) -> tuple[float, ...]:
        q, v = tuple(y[:n].tolist()), tuple(y[n : 2 * n].tolist())
        acceleration, _losses = system.rates(SCALAR, q, v, control)
        return (*v, *acceleration, control * v[plant.actuated])

    q, v = split_state(tuple(float(x) for x in state))
    points = [np.array([*q, *v, 0.0])]
    for control in controls:
        found = solve(
            slopes, (0.0, control_period), points[-1], method="DOP853", rtol=TOLERANCE,
            atol=TOLERANCE, args=(float(control),),
        )  # fmt: skip
        if not found.success:
            raise ValueError(f"SciPy cannot follow {plant.name}: {found.message}")
        points.append(found.y[:, -1])
    table = np.array(points)
    pairs = [(tuple(y[:n]), tuple(y[n : 2 * n])) for y in table.tolist()]
    energy = np.array([system.energy(SCALAR, *pair) for pair in pairs])
    work = table[:, 2 * n]
    states = np.array([join_state(*pair) for pair in pairs])
    return IndependentMotion(states, energy, work, work - (energy - energy[0]))
