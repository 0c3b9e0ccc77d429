"""Rigid-body engines that move all lanes of a vector environment in one call."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from ...arithmetic.ops import Component, Components, Ops
from .._stepping.foreign import ASTRAY
from .agreement import Array
from .bodies import RigidBodyEngine


class LanesEngine(RigidBodyEngine):
    """Advances one environment by floats and many by arrays."""

    guarded_strides: ClassVar[bool] = True

    @abstractmethod
    def run_lanes(self, starts: Array, count: int) -> Array:
        """Take ``count`` steps: (lanes, 3 dof) of q, v and force, finite, to (lanes, 2 dof).

        Of an engine that reports, to three columns more: iterations, residual and convergence.
        """

    def travel(
        self, ops: Ops, q: Components, v: Components, force: Components, count: int
    ) -> tuple[Components, Components, Component, Component, Component]:
        """Take ``count`` steps; q, v, and the solver's iterations, residual and convergence."""
        if not isinstance(q[0], np.ndarray):
            return super().travel(ops, q, v, force, count)
        dof = len(q)
        starts = np.empty((len(q[0]), 3 * dof))
        for column, values in enumerate((*q, *v, *force)):
            starts[:, column] = values
        lost = ~(np.linalg.norm(starts, axis=1) < ASTRAY)
        starts[lost] = 0.0
        ends = self.run_lanes(starts, count)
        ends[lost, : 2 * dof] = np.nan
        columns = tuple(np.ascontiguousarray(ends.T))
        q, v, report = columns[:dof], columns[dof : 2 * dof], columns[2 * dof :]
        if not self.reports:
            return q, v, 0, 0.0, True
        iterations, residual, converged = report
        return q, v, iterations, residual, (converged != 0.0) & ~lost
