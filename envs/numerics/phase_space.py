"""What steps do to phase space: volume, the canonical form, and the way back."""

from __future__ import annotations

import numpy as np

from ..arithmetic.array_ops import ARRAY
from ..plants.interface import Plant, split_state
from .stepping import WIDTH, Advance, Array, State, advance, advance_lanes, jacobian


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
