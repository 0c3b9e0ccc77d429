"""Engines that run on NVIDIA Warp: their step recorded once and replayed, on the CPU."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from integ_gym.support import load

from ...arithmetic import Components
from ...mechanics import Stops
from .._rigid import Array, LanesEngine
from .._stepping import Run, quiet

FEWEST = 16
"""Worlds are made in this number or the next power of two above it, whatever lanes are moved."""

Floats = npt.NDArray[np.float32]
Counts = npt.NDArray[np.int32]


class ConstraintSolver(NamedTuple):
    """What a simulator tells of the solver of its constraints."""

    iterations: Counts
    """Of the last step in each world: the simulator's own memory, (worlds,)."""
    tolerance: float
    cap: int


@dataclass(frozen=True)
class Worlds:
    """Some copies of the mechanism in a simulator.

    Attributes:
        q: the simulator's own memory, (worlds, dof), float32.
        v: likewise.
        force: likewise.
        step: advances them by one step.
        simulation: what the simulator keeps.
        solver: of its constraints; None where it has none.
    """

    q: Floats
    v: Floats
    force: Floats
    step: Callable[[], None]
    simulation: Any
    solver: ConstraintSolver | None = None


class WarpEngine(LanesEngine):
    """Advances worlds side by side, one for a single environment and one per lane for many.

    The launches of a step are recorded when the worlds are made, and replayed from then on. A
    kernel that Warp has not yet got in its cache is compiled then, which can take a minute once.
    """

    width: ClassVar[int] = 32
    extra: ClassVar[str]

    @property
    def solves(self) -> bool:
        """Whether its stops are constraints, with a solver that tells of itself."""
        return True

    def build(self) -> None:
        """Load the simulator."""
        with quiet():
            self._warp = load("warp", self.extra)
            self.open()
        self.reports = self.system.engine_stops is not None and self.solves
        self._made: dict[tuple[int, Stops | None], tuple[Worlds, Any]] = {}

    @abstractmethod
    def open(self) -> None:
        """Import it."""

    @abstractmethod
    def worlds(self, count: int, stops: Stops | None) -> Worlds:
        """Make ``count`` worlds, with the simulator's own stops or without."""

    def solver(self) -> dict[str, Any]:
        """Tolerance and iteration cap of the constraint solver, where there are constraints."""
        solver = self._recorded(1, None)[0].solver
        if solver is None or not self.reports:
            return super().solver()
        return {"solver_tolerance": solver.tolerance, "solver_cap": solver.cap}

    def run(self, count: int) -> Run:
        """Take ``count`` steps of one world."""
        worlds, graph = self._recorded(1, self.system.engine_stops)
        (q,), (v,), (force,) = worlds.q, worlds.v, worlds.force
        n, take = len(q), self._replayed(worlds, graph, count)

        def run(*start: float) -> tuple[float, ...]:
            q[:], v[:], force[:] = start[:n], start[n : 2 * n], start[2 * n :]
            report = [column.item(0) for column in take()]
            return (*q.tolist(), *v.tolist(), *report)

        return run

    def run_lanes(self, starts: Array, count: int) -> Array:
        """Take ``count`` steps of at least as many worlds as there are lanes."""
        lanes = len(starts)
        most = max(FEWEST, 1 << (lanes - 1).bit_length())
        worlds, graph = self._recorded(most, self.system.engine_stops)
        memory = worlds.q, worlds.v, worlds.force
        for array, values in zip(memory, np.split(starts, 3, axis=1), strict=True):
            array[:lanes], array[lanes:] = values, 0.0
        report = self._replayed(worlds, graph, count)()
        columns = (worlds.q, worlds.v, *[column[:, None] for column in report])
        return np.concatenate([x[:lanes] for x in columns], axis=1, dtype=np.float64)

    def started(self, q: Components) -> Worlds:
        """A world without stops after a step from rest in ``q``."""
        worlds, graph = self._recorded(1, None)
        worlds.q[:], worlds.v[:], worlds.force[:] = q, 0.0, 0.0
        self._warp.capture_launch(graph)
        return worlds

    def _replayed(
        self, worlds: Worlds, graph: Any, count: int
    ) -> Callable[[], tuple[npt.NDArray[Any], ...]]:
        """What takes ``count`` steps and tells, if the engine reports, what the solver did.

        That is most iterations of any step, 0 and convergence, (worlds,) each.
        """
        replay, solver = self._warp.capture_launch, worlds.solver

        def silently() -> tuple[npt.NDArray[Any], ...]:
            for _ in range(count):
                replay(graph)
            return ()

        if solver is None or not self.reports:
            return silently

        def reporting() -> tuple[npt.NDArray[Any], ...]:
            most = np.zeros_like(solver.iterations)
            for _ in range(count):
                replay(graph)
                np.maximum(most, solver.iterations, out=most)
            return most, np.zeros(len(most)), most < solver.cap

        return reporting

    @contextmanager
    def here(self) -> Iterator[None]:
        """Warp at work on the CPU, without a word."""
        with quiet(), self._warp.ScopedDevice("cpu"):
            yield

    def _recorded(self, count: int, stops: Stops | None) -> tuple[Worlds, Any]:
        """``count`` worlds, and their step as a graph of launches."""
        key = count, stops
        if key not in self._made:
            with self.here():
                worlds = self.worlds(count, stops)
                worlds.step()
                with self._warp.ScopedCapture(device="cpu") as capture:
                    worlds.step()
            self._made[key] = worlds, capture.graph
        return self._made[key]
