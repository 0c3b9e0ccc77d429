"""Accuracy of one-step maps: order, symplecticity, reversibility, an independent solution."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from integ_gym.support.errors import InputError
from integ_gym.support.optional import load

from ..ops.ops import ARRAY, SCALAR, join_state, split_state
from ..plants.interface import Plant, controls_of
from ..plants.system import PlantSystem
from .stepping import WIDTH, Advance, Array, State, advance, advance_lanes, jacobian

HALVINGS = (4, 5, 6, 7, 8, 9)
"""Steps are duration / 2**k."""

ROUNDING = 1e-12
"""Errors below this share of the state's size measure the arithmetic, not the method."""


@dataclass(frozen=True)
class Convergence:
    """Errors after a fixed time over a ladder of steps.

    Attributes:
        steps_s: steps from coarse to fine, s.
        errors: Euclidean norm of the error in (q, v / frequency), per step.
        order: as :func:`slope` measures it.
    """

    steps_s: tuple[float, ...]
    errors: tuple[float, ...]
    order: float | None


def convergence(
    integrator: str,
    plant: Plant,
    state: State,
    duration_s: float = 0.5,
    truth: State | None = None,
    frequency: float = 1.0,
    control: float = 0.0,
    halvings: Sequence[int] = HALVINGS,
    follow: Advance = advance,
    rounding: float = ROUNDING,
) -> Convergence:
    """Measure the order on the motion from a state under a constant control.

    Args:
        integrator: a registered name or ``"module:Class"``.
        plant: with numbers as parameters.
        state: start, shape (n,), in state order.
        duration_s: length of the motion; a few radians of the fastest oscillation at most, else
            phase errors hide the slope.
        truth: the state at its end; None: by the ``reference`` integrator.
        frequency: ω in the norm (q, v / ω), rad/s.
        control: held throughout, in the plant's unit.
        halvings: exponents k of the steps duration / 2**k.
        follow: what takes the steps.
        rounding: share of the state's size below which an error measures the arithmetic.
    """
    if truth is None:
        truth = follow("reference", plant, state, duration_s, 1, control)
    exact = np.asarray(truth, dtype=np.float64)
    weights = np.tile([1.0, 1.0 / frequency], len(exact) // 2)
    steps = tuple(duration_s / 2**k for k in halvings)
    errors = tuple(
        float(
            np.linalg.norm(weights * (follow(integrator, plant, state, h, 2**k, control) - exact))
        )
        for k, h in zip(halvings, steps, strict=True)
    )
    floor = rounding * (1.0 + float(np.linalg.norm(weights * exact)))
    return Convergence(steps, errors, slope(steps, errors, floor))


def slope(steps: Sequence[float], errors: Sequence[float], floor: float) -> float | None:
    """d log error / d log step between the two finest steps whose errors are above ``floor``.

    Args:
        steps: from coarse to fine, s.
        errors: one per step; not finite where the motion diverged.
        floor: errors up to this are rounding.

    Returns:
        None where there are no two such steps: the method is exact to rounding; NaN where it
        diverges at the finest step.
    """
    if not math.isfinite(errors[-1]):
        return math.nan
    usable = [(h, e) for h, e in zip(steps, errors, strict=True) if floor < e < math.inf]
    if len(usable) < 2:
        return None
    (coarse, large), (fine, small) = usable[-2:]
    return float(np.log(large / small) / np.log(coarse / fine))


def canonical_jacobian(
    integrator: str,
    plant: Plant,
    state: State,
    dt: float,
    control: float = 0.0,
    width: float = WIDTH,
) -> Array:
    """∂(q₁, p₁)/∂(q₀, p₀) of one step with p = M(q) v, by central differences.

    Args:
        integrator: a registered name or ``"module:Class"``.
        plant: with numbers as parameters.
        state: where the step begins, shape (n,), in state order.
        dt: step, s.
        control: in the plant's unit.
        width: offset of the difference quotients.

    Returns:
        Shape (n, n), first the coordinates, then the momenta.
    """

    def one_step(points: Array) -> Array:
        return _momenta(
            plant, advance_lanes(integrator, plant, _velocities(plant, points), dt, control)
        )

    start = np.asarray(state, dtype=np.float64)[None]
    return jacobian(one_step, _momenta(plant, start)[0], width)


def volume_defect(
    integrator: str,
    plant: Plant,
    state: State,
    dt: float,
    control: float = 0.0,
    width: float = WIDTH,
) -> float:
    """det ∂(q₁, p₁)/∂(q₀, p₀) − 1: what one step adds to a small volume of phase space.

    Zero for a symplectic step; negative where the step contracts. Arguments as
    :func:`canonical_jacobian`.
    """
    slopes = canonical_jacobian(integrator, plant, state, dt, control, width)
    return float(np.linalg.det(slopes) - 1.0)


def symplecticity_defect(
    integrator: str, plant: Plant, state: State, dt: float, control: float = 0.0
) -> float:
    """max |JᵀΩJ − Ω| with J = ∂(q₁, p₁)/∂(q₀, p₀): zero for a symplectic step.

    Arguments as :func:`canonical_jacobian`.
    Source: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., VI.2.
    """
    step = canonical_jacobian(integrator, plant, state, dt, control)
    zero, one = np.zeros((len(step) // 2,) * 2), np.eye(len(step) // 2)
    form = np.block([[zero, one], [-one, zero]])
    return float(np.abs(step.T @ form @ step - form).max())


def reversibility_errors(
    integrator: str,
    plant: Plant,
    state: State,
    dt: float,
    duration_s: float = 10.0,
    control: float = 0.0,
    follow: Advance = advance,
) -> Array:
    """|state − start| after going forward, turning all velocities round, and coming back.

    Rounding for a reversible integrator on a plant without damping.

    Args:
        integrator: a registered name or ``"module:Class"``.
        plant: with numbers as parameters.
        state: start, shape (n,), in state order.
        dt: step, s.
        duration_s: length of the way out.
        control: held throughout, in the plant's unit.
        follow: what takes the steps.

    Returns:
        Shape (n,), in state order and SI units; NaN where the arithmetic fails.

    Source: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., V.1.
    """
    start = np.asarray(state, dtype=np.float64)
    turn = np.tile([1.0, -1.0], len(start) // 2)
    steps = round(duration_s / dt)
    away = follow(integrator, plant, start, dt, steps, control)
    if not np.isfinite(away).all():
        return away
    back: Array = turn * follow(integrator, plant, turn * away, dt, steps, control)
    return np.abs(back - start)


def _mass_matrices(plant: Plant, q: Array) -> Array:
    """M(q) of shape (lanes, dof, dof) at configurations (lanes, dof)."""
    rows = plant.mass_matrix(ARRAY, tuple(q.T))
    return np.stack([np.stack([np.broadcast_to(x, len(q)) for x in row], -1) for row in rows], -2)


def _momenta(plant: Plant, states: Array) -> Array:
    """(lanes, n) in state order to (q, p)."""
    q, v = (np.stack(x, -1) for x in split_state(tuple(states.T)))
    return np.concatenate([q, np.einsum("lij,lj->li", _mass_matrices(plant, q), v)], axis=-1)


def _velocities(plant: Plant, points: Array) -> Array:
    """(lanes, n) in (q, p) to state order."""
    q, p = np.split(points, 2, axis=-1)
    v = np.linalg.solve(_mass_matrices(plant, q), p[..., None])[..., 0]
    states = np.empty_like(points)
    states[:, 0::2], states[:, 1::2] = q, v
    return states


TOLERANCE = 1e-13
"""Relative and absolute, of every inner step."""


@dataclass(frozen=True)
class IndependentMotion:
    """A motion at its control instants, from time 0.

    Attributes:
        states: in state order, SI units, shape (instants, n).
        energy: of the plant and its stops, J, shape (instants,).
        work: ∫ u q̇ dt of the controls so far, J, shape (instants,).
        lost: work − change of energy so far, J, shape (instants,): what damping, friction and
            stops have taken out, whatever the plant says of its dissipation.
    """

    states: Array
    energy: Array
    work: Array
    lost: Array


def independent_motion(
    plant: Plant, state: State, controls: Sequence[Any] | Array, control_period: float
) -> IndependentMotion:
    """Follow a plant under held controls with ``solve_ivp(method="DOP853")``.

    Neither an integrator nor the energy ledger of integ-gym takes part.

    Args:
        plant: with numbers as parameters.
        state: start, shape (n,), in state order.
        controls: one per control period, in the plant's units: a number for every control of the
            plant, or a tuple with one of each.
        control_period: s.

    Raises:
        ModuleNotFoundError: without SciPy, with the command that installs it.
        ValueError: where SciPy cannot follow the motion.
    """
    solve = load("scipy.integrate", "report").solve_ivp
    system, n = PlantSystem(plant), len(state) // 2

    def slopes(_: float, y: Array, *held: float) -> tuple[float, ...]:
        q, v = tuple(y[:n].tolist()), tuple(y[n : 2 * n].tolist())
        acceleration, _losses = system.rates(SCALAR, q, v, held)
        return (*v, *acceleration, system.power(SCALAR, q, v, held))

    q, v = split_state(tuple(float(x) for x in state))
    points = [np.array([*q, *v, 0.0])]
    for control in controls:
        found = solve(
            slopes, (0.0, control_period), points[-1], method="DOP853", rtol=TOLERANCE,
            atol=TOLERANCE, args=tuple(map(float, controls_of(plant, control))),
        )  # fmt: skip
        if not found.success:
            raise InputError(f"SciPy cannot follow {plant.name}: {found.message}")
        points.append(found.y[:, -1])
    table = np.array(points)
    pairs = [(tuple(y[:n]), tuple(y[n : 2 * n])) for y in table.tolist()]
    energy = np.array([system.energy(SCALAR, *pair) for pair in pairs])
    work = table[:, 2 * n]
    states = np.array([join_state(*pair) for pair in pairs])
    return IndependentMotion(states, energy, work, work - (energy - energy[0]))
