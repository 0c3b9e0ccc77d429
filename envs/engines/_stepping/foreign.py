"""Engines whose steps are not made of our own arithmetic: one call of floats for each."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import cache
from math import hypot, nan
from typing import Any, ClassVar

from ...arithmetic.ops import Component, Components, Ops
from ...integrators.interface import Step
from ...mechanics.system import PlantSystem
from ..interface import DIVERGENCE_SPEED, Motion, Segments
from .mapped import MappedEngine
from .stepped import within_bounds

Run = Callable[..., tuple[Any, ...]]
"""(*q, *v, *force) to (*q, *v), and (iterations, residual, converged) of an engine that reports."""

CALM_SPEED = DIVERGENCE_SPEED / 20.0
"""Steps are taken by the stride only where no velocity is beyond this before and after them."""

ASTRAY = 1e9
"""An engine is not asked to go on from values whose norm is beyond this, or not finite."""


class ForeignEngine(MappedEngine):
    """Advances a plant by an engine that is called with floats; lanes one by one."""

    guarded_strides: ClassVar[bool] = False
    """Whether runs of several steps, too, are kept from values that are astray."""

    def __init__(self, system: PlantSystem, integrator: str, dt: float) -> None:
        super().__init__(system, integrator, dt)
        self._run = cache(self._safe_run)

    @abstractmethod
    def run(self, count: int) -> Run:
        """A function that takes ``count`` steps under a constant generalized force."""

    @property
    @abstractmethod
    def straight(self) -> bool:
        """Whether the steps of one control may be taken by one :meth:`stride`."""

    def advance(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        segments: Segments,
        sample_at: Component | None,
    ) -> Motion:
        """Advance through the segments of constant control, in one call each where possible.

        A motion that is fast at either end of a call is done again step by step, so that a step at
        which it diverges is seen.
        """
        if self.straight and sample_at is None:
            motion, hurried = self._in_strides(ops, q, v, segments)
            if ops.usually(ops.any(hurried) == False):  # noqa: E712
                return motion
        return super().advance(ops, q, v, segments, sample_at)

    def _in_strides(
        self, ops: Ops, q: Components, v: Components, segments: Segments
    ) -> tuple[Motion, Component]:
        """One call for each segment; and whether the motion was fast at an end of one."""
        calm = within_bounds(q, v, CALM_SPEED)
        actuated, work = self.system.plant.actuated, 0.0
        losses, most, worst, converged = self.system.no_losses, 0, 0.0, True
        for control, count in segments:
            before = q[actuated]
            force = self.system.generalized(control)
            q, v, losses, iterations, residual, solved, _ = self.stride(
                ops, q, v, losses, force, count
            )
            work = work + control * (q[actuated] - before)
            most, worst = ops.maximum(most, iterations), ops.maximum(worst, residual)
            converged = converged & solved
            calm = calm & within_bounds(q, v, CALM_SPEED)
        motion = Motion(q, v, q, v, work, losses, 0.0, most, worst, converged, calm)
        return motion, calm == False  # noqa: E712

    def stride(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        losses: Components,
        force: Components,
        count: int,
    ) -> Step:
        """Take ``count`` steps in one call, without a loss."""
        q, v, *report = self.travel(ops, q, v, force, count)
        return Step(q, v, losses, *report)

    def travel(
        self, ops: Ops, q: Components, v: Components, force: Components, count: int
    ) -> tuple[Components, Components, Component, Component, Component]:
        """Take ``count`` steps; q, v, and the solver's iterations, residual and convergence."""
        n = len(q)
        flat, report = self._called_with(ops, self._run(count), (*q, *v, *force), 2 * n)
        return flat[:n], flat[n:], *report

    def _called_with(
        self, ops: Ops, run: Run, values: Components, numbers: int
    ) -> tuple[Components, Components]:
        """What a run gives: so many numbers, and the solver's report or that nothing went wrong."""
        truths = (*[False] * numbers, *((False, False, True) if self.reports else ()))
        flat = ops.foreign(run, values, truths)
        return flat[:numbers], flat[numbers:] or (0, 0.0, True)

    def _safe_run(self, count: int) -> Run:
        made = self.run(count)
        if count > 1 and not self.guarded_strides:
            return made
        report = (0, 0.0, False) if self.reports else ()
        return guarded(made, (*(nan,) * (2 * len(self.system.plant.coordinates)), *report))


def guarded(run: Run, lost: tuple[Any, ...]) -> Run:
    """``run``, but ``lost`` from arguments that are astray."""

    def safe(*values: float) -> tuple[Any, ...]:
        return run(*values) if hypot(*values) < ASTRAY else lost

    return safe


def is_astray(values: Sequence[float]) -> bool:
    """Whether the values' norm is beyond :data:`ASTRAY`, or not finite."""
    return not hypot(*values) < ASTRAY
