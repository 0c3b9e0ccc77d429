"""What engines on NVIDIA Warp share, and MuJoCo Warp: worlds side by side, on the CPU."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from integ_gym.support.optional import load

from ..mechanics import Mechanism
from ..ops.ops import Components
from .mujoco_solver import MujocoSettings, translate_refusal, write_solver
from .rigid import LEAST_INERTIA, MAPS, Array, LanesEngine, mass_matrix, mjcf, stop_law
from .simulator import Run, silence_output

FEWEST = 16
"""Worlds are made in this number or the next power of two above it, whatever lanes are moved."""

ROWS = 2
"""Constraints to make room for in a world: one side of a limited joint at a time, and no fewer than
one, for without any MuJoCo Warp leaves the forces out of `Euler`, `implicitfast` and `implicit`."""

Floats = npt.NDArray[np.float32]
Counts = npt.NDArray[np.int32]


class ConstraintSolver(NamedTuple):
    """What a simulator reports of the solver of its constraints."""

    iterations: Counts
    """Of the last step in each world: the simulator's own memory, (worlds,)."""
    tolerance: float
    cap: int

    @property
    def limits(self) -> dict[str, Any]:
        """Where it stops, by MuJoCo's names."""
        return {"tolerance": self.tolerance, "iterations": self.cap}


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

    width: int = 32

    def build(self) -> None:
        """Load the simulator; its stops are reported on where they are constraints."""
        with silence_output():
            self._warp = load("warp", self.name)
            self.open()
        self._recorded = cache(self._record)
        solver = self._recorded(1, False)[0].solver
        if self.system.engine_stops is not None and solver is not None:
            self.reports = True
            self.solver_tolerance, self.solver_cap = solver.tolerance, solver.cap

    @abstractmethod
    def open(self) -> None:
        """Import it."""

    @abstractmethod
    def worlds(self, count: int, mechanism: Mechanism) -> Worlds:
        """Make ``count`` worlds with a mechanism each."""

    def run(self, count: int) -> Run:
        """Take ``count`` steps of one world."""
        worlds, graph = self._recorded(1, True)
        (q,), (v,), (force,) = worlds.q, worlds.v, worlds.force
        n, take = len(q), self._capture_steps(worlds, graph, count)

        def run(*start: float) -> tuple[float, ...]:
            q[:], v[:], force[:] = start[:n], start[n : 2 * n], start[2 * n :]
            report = [column.item(0) for column in take()]
            return (*q.tolist(), *v.tolist(), *report)

        return run

    def run_lanes(self, starts: Array, count: int) -> Array:
        """Take ``count`` steps of at least as many worlds as there are lanes."""
        lanes = len(starts)
        most = max(FEWEST, 1 << (lanes - 1).bit_length())
        worlds, graph = self._recorded(most, True)
        memory = worlds.q, worlds.v, worlds.force
        for array, values in zip(memory, np.split(starts, 3, axis=1), strict=True):
            array[:lanes], array[lanes:] = values, 0.0
        report = self._capture_steps(worlds, graph, count)()
        columns = (worlds.q, worlds.v, *[column[:, None] for column in report])
        return np.concatenate([x[:lanes] for x in columns], axis=1, dtype=np.float64)

    def started(self, q: Components) -> Worlds:
        """A world without stops after a step from rest in ``q``."""
        worlds, graph = self._recorded(1, False)
        worlds.q[:], worlds.v[:], worlds.force[:] = q, 0.0, 0.0
        self._warp.capture_launch(graph)
        return worlds

    def _capture_steps(
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
        with silence_output(), self._warp.ScopedDevice("cpu"):
            yield

    def _record(self, count: int, stopped: bool) -> tuple[Worlds, Any]:
        """``count`` worlds, with stops of their own or without, and their step as launches."""
        with self.here():
            worlds = self.worlds(count, self.mechanism if stopped else self.free)
            worlds.step()
            with self._warp.ScopedCapture(device="cpu") as capture:
                worlds.step()
        return worlds, capture.graph


def constraint_solver(mjw: Any, model: Any, data: Any) -> ConstraintSolver:
    """Of MuJoCo Warp's model and data; from now on it reaches its cap without printing it."""
    option = model.opt
    option.warn_overflow &= ~mjw.OverflowType.ITERATIONS
    tolerance = float(option.tolerance.numpy()[0])
    return ConstraintSolver(data.solver_niter.numpy(), tolerance, int(option.iterations))


def forces_at_rest(
    mujoco: Any, mjw: Any, made: Any, model: Any, data: Any, q: Components
) -> tuple[Array, Array]:
    """Mass matrix and generalized force, without springs, of MuJoCo Warp's first world at rest.

    Args:
        mujoco: the module.
        mjw: MuJoCo Warp's.
        made: MuJoCo's model.
        model: MuJoCo Warp's.
        data: likewise.
        q: configuration.
    """
    data.qpos.assign([q])
    data.qvel.zero_()
    mjw.forward(model, data)
    packed = mujoco.MjData(made)
    packed.M[:] = data.M.numpy()[0]
    force = data.qfrc_smooth.numpy()[0] - data.qfrc_spring.numpy()[0]
    return mass_matrix(mujoco, made, packed), np.array(force, np.float64)


class MujocoWarpEngine(MujocoSettings, WarpEngine):
    """`mujoco_warp.step`, in float32, on the CPU; all lanes of a vector environment at once.

    Its integrators are MuJoCo's; see :class:`integ_gym.envs.engines.mujoco.MujocoEngine`.
    With its own stops it reports as MuJoCo does; a step without a constraint takes its solver one
    iteration.
    """

    name: ClassVar[str] = "mujoco_warp"
    package: ClassVar[str] = "mujoco-warp"
    modules: ClassVar[tuple[str, ...]] = ("mujoco", "mujoco_warp", "warp")
    least_inertia: ClassVar[float] = LEAST_INERTIA
    own_springs: ClassVar[bool] = True
    maps: ClassVar[Mapping[str, str]] = MAPS

    def open(self) -> None:
        """Load MuJoCo and MuJoCo Warp."""
        self._mujoco = load("mujoco", self.name)
        self._mjw = load("mujoco_warp", self.name)

    def worlds(self, count: int, mechanism: Mechanism) -> Worlds:
        """One model, with data for ``count`` worlds."""
        compiled = self._compile_model(mechanism)
        with translate_refusal("MuJoCo Warp"):
            model = self._mjw.put_model(compiled)
        data = self._mjw.make_data(compiled, nworld=count, nconmax=0, njmax=ROWS)

        def step() -> None:
            data.qacc_warmstart.zero_()
            self._mjw.step(model, data)

        q, v, force = (x.numpy() for x in (data.qpos, data.qvel, data.qfrc_applied))
        solver = constraint_solver(self._mjw, model, data)
        self.settings = {**self.settings_of(self._mujoco, compiled), **solver.limits}
        return Worlds(q, v, force, step, (compiled, model, data), solver)

    def stop_parameters(self) -> dict[str, Any]:
        """`solref` and `solimp` of the limited joint."""
        return stop_law(self._compile_model(self.mechanism), self.system.engine_stops)

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix by the composite rigid body algorithm, and all of the generalized force."""
        made, model, data = self.started(q).simulation
        with self.here():
            return forces_at_rest(self._mujoco, self._mjw, made, model, data, q)

    def _compile_model(self, mechanism: Mechanism) -> Any:
        """MuJoCo's model, with the settings of its solver."""
        model = self._mujoco.MjModel.from_xml_string(mjcf(mechanism, self.dt, self.integrator))
        write_solver(self._mujoco, model, self.settings)
        return model
