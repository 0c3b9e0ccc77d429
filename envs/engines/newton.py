"""Newton, the engine that Isaac Lab moves to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar

import numpy as np

from integ_gym.support import load

from ..arithmetic import Components
from ..mechanics import Link, Stops
from ._rigid import LEAST_INERTIA, MAPS, Array, moment
from ._warp import ROWS, ConstraintSolver, WarpEngine, Worlds, constraint_solver, mass_matrix

FEATHERSTONE = "featherstone"

_MUJOCO = {f"mujoco_{name.lower()}": one_step_map for name, one_step_map in MAPS.items()}


class NewtonEngine(WarpEngine):
    """Newton's solvers, in float32, on the CPU; all lanes of a vector environment at once.

    `featherstone` is `SolverFeatherstone`, symplectic Euler; `mujoco_euler`, `mujoco_implicitfast`,
    `mujoco_implicit`, `mujoco_discrete` and `mujoco_rk4` are `SolverMuJoCo` with MuJoCo Warp, and
    report its constraint solver. Featherstone's stops are springs, without a solver to report on.
    """

    name: ClassVar[str] = "newton"
    package: ClassVar[str] = "newton"
    modules: ClassVar[tuple[str, ...]] = ("mujoco", "mujoco_warp", "newton", "warp")
    extra: ClassVar[str] = "newton"
    own_stops: ClassVar[bool] = True
    least_inertia: ClassVar[float] = LEAST_INERTIA
    maps: ClassVar[Mapping[str, str]] = {FEATHERSTONE: "symplectic_euler", **_MUJOCO}
    KERNELS: ClassVar[tuple[str, ...]] = (
        "newton._src.sim.articulation",
        "newton._src.solvers.featherstone.kernels",
        "newton._src.solvers.mujoco.kernels",
    )
    """Modules whose kernels come with derivatives, which take most of the time to compile."""

    @property
    def solves(self) -> bool:
        """Whether its stops are constraints, with a solver that tells of itself."""
        return self.integrator in _MUJOCO

    def open(self) -> None:
        """Load Newton, and MuJoCo Warp where its solver is asked for."""
        self._newton = load("newton", self.extra)
        if self.integrator in _MUJOCO:
            self._mujoco, self._mjw = load("mujoco", self.extra), load("mujoco_warp", self.extra)

    def worlds(self, count: int, stops: Stops | None) -> Worlds:
        """A model of ``count`` worlds and its solver."""
        model = self._model(count, stops)
        solver = self._solver(model)
        now, then, control = model.state(), model.state(), model.control()

        def step() -> None:
            self._forget(solver)
            solver.step(now, then, control, None, self.dt)
            self._warp.copy(now.joint_q, then.joint_q)
            self._warp.copy(now.joint_qd, then.joint_qd)

        memory = (now.joint_q, now.joint_qd, control.joint_f)
        q, v, force = (x.numpy().reshape(count, -1) for x in memory)
        simulation = (model, solver, now, then, control)
        return Worlds(q, v, force, step, simulation, self._constraint_solver(solver))

    def stop_parameters(self) -> dict[str, Any]:
        """`limit_ke` and `limit_kd` of the limited joint."""
        joint = self._builder().default_joint_cfg
        return {"limit_ke": joint.limit_ke, "limit_kd": joint.limit_kd}

    def inertia(self, q: Components) -> Array:
        """Mass matrix of the solver."""
        solver = self._at_rest(q)
        if self.integrator in _MUJOCO:
            return mass_matrix(self._mujoco, solver.mj_model, solver.mjw_data)
        return np.array(solver.H.numpy(), dtype=np.float64).reshape(len(q), -1)

    def gravity(self, q: Components) -> Array:
        """All of the generalized force at rest."""
        solver = self._at_rest(q)
        force = solver.joint_tau if self.integrator == FEATHERSTONE else solver.mjw_data.qfrc_smooth
        return np.array(force.numpy(), dtype=np.float64).reshape(-1)[: len(q)]

    def _solver(self, model: Any) -> Any:
        """The solver; Featherstone's own angular damping of 0.05 1/s is turned off."""
        solvers = self._newton.solvers
        if self.integrator == FEATHERSTONE:
            return solvers.SolverFeatherstone(model, angular_damping=0.0)
        return solvers.SolverMuJoCo(
            model,
            integrator=self.integrator.removeprefix("mujoco_"),
            njmax=ROWS,
            nconmax=0,
            disable_contacts=True,
            kinematic_switchable_roots=False,
        )

    def _constraint_solver(self, solver: Any) -> ConstraintSolver | None:
        if not self.solves:
            return None
        return constraint_solver(self._mjw, solver.mjw_model, solver.mjw_data)

    def _model(self, count: int, stops: Stops | None) -> Any:
        """As many equal worlds; inertias are kept as they are given."""
        one, all_of_them = self._builder(), self._builder()
        parent, joints = -1, []
        for place, link in enumerate(self.mechanism.links):
            limit = stops.limit if stops is not None and stops.coordinate == place else None
            parent, joint = self._hung(one, parent, link, limit)
            joints.append(joint)
        one.add_articulation(joints)
        for _ in range(count):
            all_of_them.add_world(one)
        return all_of_them.finalize(skip_all_validations=True)

    def _builder(self) -> Any:
        newton = self._newton
        down = (0.0, 0.0, -self.mechanism.gravity)
        return newton.ModelBuilder(up_axis=newton.Axis.Z, gravity=down)

    def _hung(self, builder: Any, parent: int, link: Link, limit: float | None) -> tuple[int, int]:
        """Add a link on its joint; the numbers of both."""
        axes, warp = self._newton.Axis, self._warp
        body = builder.add_link(
            mass=link.mass,
            com=warp.vec3(0.0, 0.0, link.centre),
            inertia=warp.mat33(np.diag([max(moment(link), LEAST_INERTIA)] * 3)),
        )
        slides = link.joint == "slide"
        add = builder.add_joint_prismatic if slides else builder.add_joint_revolute
        joint = add(
            parent,
            body,
            axis=axes.X if slides else axes.Y,
            damping=link.damping,
            armature=0.0,
            friction=0.0,
            limit_lower=None if limit is None else -limit,
            limit_upper=limit,
        )
        return body, joint

    def _forget(self, solver: Any) -> None:
        """Start the constraint solver from nothing, so that a step depends on its state alone."""
        if self.integrator in _MUJOCO:
            solver.mjw_data.qacc_warmstart.zero_()

    def _at_rest(self, q: Components) -> Any:
        """A solver that has just looked at one world at rest in ``q``."""
        _, solver, *_ = self.started(q).simulation
        if self.integrator in _MUJOCO:
            solver.mjw_data.qpos.assign([q])
            solver.mjw_data.qvel.zero_()
            with super().here():
                self._mjw.forward(solver.mjw_model, solver.mjw_data)
        return solver

    @contextmanager
    def here(self) -> Iterator[None]:
        """Warp at work on the CPU, without a word, its kernels without their derivatives."""
        with super().here(), self._without_derivatives():
            yield

    @contextmanager
    def _without_derivatives(self) -> Iterator[None]:
        """Compile kernels as they are used here; whoever wants derivatives still gets them."""
        options, warp = "enable_backward", self._warp
        kept = [warp.get_module_options(module=name)[options] for name in self.KERNELS]
        for name in self.KERNELS:
            warp.set_module_options({options: False}, module=name)
        try:
            yield
        finally:
            for name, value in zip(self.KERNELS, kept, strict=True):
                warp.set_module_options({options: value}, module=name)
