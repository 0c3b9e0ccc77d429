"""The line on an integrator's solver: how hard it worked, and whether it solved its equation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from integ_gym.envs.registries import INTEGRATORS

from ..bench.rollout import Rollout
from ..section import Diagnosis
from .expectation import Expectation, said


def solver_line(
    diagnosis: Diagnosis,
    integrator: str,
    rollouts: Sequence[Rollout],
    quantity: str = "most solver iterations in a step",
    steps: tuple[float, ...] = (),
    stable: Sequence[bool] = (),
) -> None:
    """Add the most iterations of each rollout, and whether every step was solved.

    Nothing is added for an integrator without a solver.

    Args:
        diagnosis: gets the line.
        integrator: a registered name or ``"module:Class"``.
        rollouts: the motions.
        quantity: what was counted, in words.
        steps: integration steps of the rollouts, s.
        stable: which of them should be solved; empty: all.
    """
    owner = INTEGRATORS.load(integrator)
    cap, tolerance = (getattr(owner, f"solver_{x}", None) for x in ("cap", "tolerance"))
    if cap is None or tolerance is None:
        return
    most = [float(np.nanmax(r.info["solver_iterations"])) for r in rollouts]
    worst = [float(np.nanmax(r.info["solver_residual"])) for r in rollouts]
    asked = [x for x, y in zip(worst, stable or [True] * len(worst), strict=True) if y]
    if not asked:
        return
    expectation = Expectation(
        "solved" if len(asked) == len(worst) else "solved where it does not grow",
        f"residual up to {said(tolerance)} in {cap} iterations",
        all(x <= tolerance for x in asked),
    )
    diagnosis.add(integrator, quantity, most, "", expectation, steps=steps)
