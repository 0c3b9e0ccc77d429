"""Simulators: engines that advance a plant by an integrator of their own."""

from __future__ import annotations

import os
import sys
import warnings
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from functools import cache
from math import hypot, nan
from typing import Any, ClassVar, cast

import numpy as np

from integ_gym.support.errors import InputError
from integ_gym.support.optional import load
from integ_gym.support.parameters import suggestion

from ..integrators.interface import State, Step
from ..ops.ops import Component, Components, Ops, along
from ..plants.system import Motion, PlantSystem
from .stepping import DIVERGENCE_SPEED, Held, Segments, SteppedEngine, solver_with, within_bounds


class MappedEngine(SteppedEngine):
    """Advances a plant whose parameters are numbers by an integrator of the engine's own.

    Args:
        system: plant with its stops, friction and speed limit.
        integrator: one of the engine's own; see :attr:`maps`.
        dt: integration step, s.
        solver: settings of the engine's solver that are not its defaults, in its own names.

    Raises:
        ValueError: for an integrator that the engine lacks, with those it has, for plant
            parameters given as arrays, and for settings that the engine lacks.
    """

    batched: ClassVar[bool] = False
    modules: ClassVar[tuple[str, ...]]
    """Modules that it imports from other packages."""
    maps: ClassVar[Mapping[str, str]]
    """Integrator, as the engine calls it, to the one-step map that it applies."""
    zero_settings: ClassVar[tuple[str, ...]] = ()
    """Settings of a solver that may be 0."""
    solver_defaults: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Integrator to settings of its solver, in the engine's own names, with their defaults."""
    stopless: ClassVar[frozenset[str]] = frozenset()
    """Integrators to which the joint stops of an engine that has them do nothing."""

    def __init__(
        self,
        system: PlantSystem,
        integrator: str,
        dt: float,
        solver: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(system, dt)
        if integrator not in self.maps:
            raise integrator_error(self.name, integrator, self.maps)
        refuse_arrays(self.name, system)
        if system.engine_stops is not None and integrator in self.stopless:
            others = ", ".join(name for name in self.maps if name not in self.stopless)
            raise InputError(
                f"integrator {integrator!r} of engine {self.name!r} ignores joint stops; use "
                f"`integrator`: {others}, or `contact`='compliant', the same law in every engine"
            )
        self.integrator = integrator
        self.read_solver(solver or {})
        self.prepare()

    def prepare(self) -> None:
        """Make what steps need; called once, last of all."""

    @classmethod
    def solves(cls, integrator: str) -> bool:
        """Whether there are settings of its solver."""
        return bool(cls.solver_defaults.get(integrator))

    def read_solver(self, given: Mapping[str, Any]) -> None:
        """Take settings of the solver: those of :attr:`solver_defaults`, or no others.

        Raises:
            ValueError: for settings that it has not, and impossible values.
        """
        defaults = self.solver_defaults.get(self.integrator, {})
        self.settings = solver_with(self.name, defaults, given, self.zero_settings)

    @property
    def map(self) -> str:
        """Name of the one-step map that the integrator applies."""
        return self.maps[self.integrator]

    def describe(self) -> dict[str, Any]:
        """What every engine says, the map that is applied, and the engine's own stops."""
        stops = None if self.system.engine_stops is None else self.stop_parameters()
        return {**super().describe(), "map": self.map, "stops": stops}

    def stop_parameters(self) -> dict[str, Any]:
        """Parameters of the engine's own joint stops, in its own names."""
        return {}


def integrator_error(engine: str, integrator: str, maps: Mapping[str, str]) -> InputError:
    """The error for an integrator that is none of an engine's, or that has another name there."""
    alike = [name for name, applied in maps.items() if applied == integrator]
    remedy = (
        f"what applies it is {' or '.join(map(repr, alike))}. Valid choices: {', '.join(maps)}"
        if alike
        else f"give `integrator`. {suggestion(integrator, maps)}"
    )
    return InputError(f"engine {engine!r} has no integrator {integrator!r}; {remedy}")


def refuse_arrays(engine: str, system: PlantSystem) -> None:
    """Check that the plant's parameters are numbers.

    Raises:
        ValueError: for one given as an array.
    """
    for name, value in vars(system.plant).items():
        if isinstance(value, np.ndarray):
            raise InputError(
                f"engine {engine!r} takes one value of `{name}` for all environments, got an "
                "array; give a number, or use engine 'native'"
            )


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

    def prepare(self) -> None:
        """Runs of steps are made when they are first asked for."""
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
        held = self.system.sampler is None and not callable(segments[0][0])
        if self.straight and sample_at is None and held:
            motion = self._in_strides(ops, q, v, cast(Held, segments))
            hurried = motion.finite == False  # noqa: E712
            if ops.assume_true(ops.any(hurried) == False):  # noqa: E712
                return motion
        return super().advance(ops, q, v, segments, sample_at)

    def _in_strides(self, ops: Ops, q: Components, v: Components, segments: Held) -> Motion:
        """One call for each segment; finite is a motion that was not fast at an end of one."""
        calm = within_bounds(q, v, CALM_SPEED)
        work: Component = 0.0
        losses, most, worst, converged = self.system.no_losses, 0, 0.0, True
        for control, count in segments:
            before = q
            force = self.system.to_generalized_force(control)
            q, v, losses, iterations, residual, solved, _ = self.stride(
                ops, q, v, losses, force, count
            )
            work = work + self.system.work(control, before, q)
            most, worst = ops.maximum(most, iterations), ops.maximum(worst, residual)
            converged = converged & solved
            calm = calm & within_bounds(q, v, CALM_SPEED)
        return Motion(q, v, q, v, work, losses, 0.0, most, worst, converged, calm)

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
        q, v, *report = self.travel_whole(ops, q, v, force, count)
        return Step(q, v, losses, *report)

    def travel_whole(
        self, ops: Ops, q: Components, v: Components, force: Components, count: int
    ) -> tuple[Components, Components, Component, Component, Component]:
        """As :meth:`travel`, of all coordinates."""
        n = len(self.system.moving)
        end_q, end_v, *report = self.travel(ops, q[:n], v[:n], force[:n], count)
        return *self.with_massless(q, v, force, count, (end_q, end_v)), *report

    def with_massless(
        self, q: Components, v: Components, force: Components, count: int, end: State
    ) -> State:
        """The end of ``count`` steps with the coordinates without mass, by symplectic Euler."""
        end_q, end_v = end
        n = len(end_q)
        if n == len(q):
            return end
        last = along(v[n:], count * self.dt, force[n:])
        return (*end_q, *along(q[n:], count * self.dt, last)), (*end_v, *last)

    def travel(
        self, ops: Ops, q: Components, v: Components, force: Components, count: int
    ) -> tuple[Components, Components, Component, Component, Component]:
        """Take ``count`` steps of the coordinates with mass.

        Returns q, v, and the solver's iterations, residual and convergence.
        """
        n = len(q)
        flat, report = self._call_engine(ops, self._run(count), (*q, *v, *force), 2 * n)
        return flat[:n], flat[n:], *report

    def _call_engine(
        self, ops: Ops, run: Run, values: Components, numbers: int
    ) -> tuple[Components, Components]:
        """What a run gives: so many numbers, and the solver's report or that nothing went wrong."""
        truths = (*[False] * numbers, *((False, False, True) if self.reports else ()))
        flat = ops.foreign(run, values, truths)
        return flat[:numbers], flat[numbers:] or (0, 0.0, True)

    def _safe_run(self, count: int) -> Run:
        run = self.run(count)
        if count > 1 and not self.guarded_strides:
            return run
        report = (0, 0.0, False) if self.reports else ()
        return guard(run, (*(nan,) * (2 * len(self.system.moving)), *report))


def guard(run: Run, lost: tuple[Any, ...]) -> Run:
    """``run``, but ``lost`` from arguments that are astray."""

    def safe(*values: float) -> tuple[Any, ...]:
        return run(*values) if hypot(*values) < ASTRAY else lost

    return safe


def is_astray(values: Sequence[float]) -> bool:
    """Whether the values' norm is beyond :data:`ASTRAY`, or not finite."""
    return not hypot(*values) < ASTRAY


def load_undisturbed(module: str, extra: str) -> Any:
    """Import a module as :func:`load` does; its first import leaves no trace but the module.

    Environment variables stay as they were; what the import writes and warns of is not shown.

    Raises:
        ModuleNotFoundError: if its package is not installed.
    """
    if module in sys.modules:
        return load(module, extra)
    before = dict(os.environ)
    try:
        with silence_output():
            return load(module, extra)
    finally:
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)


@contextmanager
def silence_output() -> Iterator[None]:
    """Leave out what is written to stdout and stderr meanwhile, by compiled code too; and warnings.

    Of the whole process: what another thread writes at that time is lost as well.
    """
    with (
        open(os.devnull, "w", encoding="utf-8") as nothing,
        _redirect(nothing.fileno(), 1, 2),
        redirect_stdout(nothing),
        redirect_stderr(nothing),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        yield


@contextmanager
def _redirect(target: int, *streams: int) -> Iterator[None]:
    """Let one file descriptor stand for others of the process."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(stream) for stream in streams]
    try:
        for stream in streams:
            os.dup2(target, stream)
        yield
    finally:
        for stream, copy in zip(streams, kept, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
