"""Lines on the energy ledger: what numerical error put in or took out."""

from __future__ import annotations

import numpy as np

from integ_gym.eval.diagnosis.bench import Rollout
from integ_gym.eval.diagnosis.order import promised
from integ_gym.eval.diagnosis.section import TRUTH, Diagnosis, steps_for
from integ_gym.eval.diagnosis.subject import Subject

EXACT = 1e-9
"""Ledger residual of the exact motion over a rollout, as a share of its largest energy."""


def ledger_line(
    diagnosis: Diagnosis, section: str, subject: Subject, integrator: str, rollouts: list[Rollout]
) -> None:
    """The line on Σ |energy residual|: rounding for the exact motion, else falling at the order."""
    steps = steps_for(subject, integrator)
    residuals = tuple(float(r.residual()[0]) for r in rollouts)
    line = (section, subject, integrator, "Σ |energy residual|", residuals, "J")
    scale = _scale(rollouts)
    if integrator == TRUTH:
        bound = EXACT * scale
        holds: bool | None = max(residuals) < bound
        diagnosis.add(*line, f"rounding: below {bound:.1e} J", holds, steps=steps)
        return
    expected, holds = promised(subject, integrator, residuals, EXACT * scale)
    holds = holds and not any(r.diverged().any() for r in rollouts)
    diagnosis.add(*line, expected, holds, steps=steps)


def rough_ledger_line(
    diagnosis: Diagnosis, section: str, subject: Subject, integrator: str, rollouts: list[Rollout]
) -> None:
    """The same where forces change within a step, so that no order is promised: it falls."""
    residuals = tuple(float(r.residual()[0]) for r in rollouts)
    bound = EXACT * _scale(rollouts)
    if integrator == TRUTH:
        expected, holds = f"rounding: below {bound:.1e} J", max(residuals) < bound
    else:
        expected = "falls with dt; no order: forces set in within a step"
        holds = residuals[-1] < max(min(residuals[:-1]), bound)
    diagnosis.add(
        section, subject, integrator, "Σ |energy residual|", residuals, "J",
        expected, holds, steps=steps_for(subject, integrator),
    )  # fmt: skip


def _scale(rollouts: list[Rollout]) -> float:
    """Largest energy of any rollout, J."""
    return max(float(np.nanmax(r.info["energy"])) for r in rollouts)
