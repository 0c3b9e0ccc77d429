"""Lines on the energy ledger: what numerical error put in, and what was booked as lost or done."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..bench.rollout import Array, Rollout
from ..section import Diagnosis
from .order import order_line

SCIPY = 1e-11
"""Errors against SciPy's integral below this share of the energy are its own."""


def ledger_line(
    diagnosis: Diagnosis,
    integrator: str,
    rollouts: dict[float, Rollout],
    name: str = "",
    **how: Any,
) -> None:
    """The line on Σ |energy residual|: rounding for the exact motion, else falling at the order.

    Args:
        diagnosis: gets the line.
        integrator: a registered name or ``"module:Class"``.
        rollouts: by step in s; of several lanes the mean is taken.
        name: of the motion, where the section has several.
        how: as for :func:`integ_gym.eval.diagnosis.lines.order.order_line`.
    """
    errors = {dt: float(r.residual().mean()) for dt, r in rollouts.items()}
    quantity = f"{name}, Σ |energy residual|" if name else "Σ |energy residual|"
    order_line(diagnosis, integrator, quantity, errors, "J", _scale(rollouts), **how)


def booked_line(
    diagnosis: Diagnosis,
    integrator: str,
    rollouts: dict[float, Rollout],
    quantity: str,
    name: str,
    truth: Array,
) -> None:
    """The line on what the ledger books so far against an independent integral.

    Args:
        diagnosis: gets the line.
        integrator: a registered name or ``"module:Class"``.
        rollouts: of one lane, by step in s.
        quantity: what is booked, in words.
        name: under which it is in ``info``.
        truth: the integral up to each control instant, J, shape (instants,).
    """
    errors = {dt: float(np.abs(r.so_far(name)[:, 0] - truth).max()) for dt, r in rollouts.items()}
    size = f"{np.abs(truth).max():.3g} J"
    order_line(
        diagnosis, integrator, f"{quantity}, largest error against SciPy's {size}", errors, "J",
        _scale(rollouts), rounding=SCIPY,
    )  # fmt: skip


def _scale(rollouts: dict[float, Rollout]) -> float:
    """Largest energy of the finest motion, J."""
    return float(np.nanmax(rollouts[min(rollouts)].info["energy"]))
