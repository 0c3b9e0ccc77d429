"""Newton, the engine that Isaac Lab moves to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar

import numpy as np

from integ_gym.support.optional import load

from ..mechanics import Mechanism
from ..ops.ops import Components
from .mujoco_solver import MujocoSettings
from .rigid import LEAST_INERTIA, MAPS, Array, moment
from .warp import ROWS, WarpEngine, Worlds, constraint_solver, forces_at_rest

FEATHERSTONE = "featherstone"

_MUJOCO = {f"mujoco_{name.lower()}": one_step_map for name, one_step_map in MAPS.items()}


SETTABLE = (
    *("solver", "cone", "jacobian", "impratio"),
    *("iterations", "ls_iterations", "tolerance", "ls_tolerance"),
)
"""Settings of MuJoCo's solver that Newton takes."""


class NewtonEngine(MujocoSettings, WarpEngine):
    """Newton's solvers, in float32, on the CPU; all lanes of a vector environment at once.

    `featherstone` is `SolverFeatherstone`, symplectic Euler; `mujoco_euler`, `mujoco_implicitfast`,
    `mujoco_implicit`, `mujoco_discrete` and `mujoco_rk4` are `SolverMuJoCo` with MuJoCo Warp, and
    report its constraint solver. Featherstone's stops are springs, without a solver to report on.
    """

    name: ClassVar[str] = "newton"
    package: ClassVar[str] = "newton"
    modules: ClassVar[tuple[str, ...]] = ("mujoco", "mujoco_warp", "newton", "warp")
    least_inertia: ClassVar[float] = LEAST_INERTIA
    maps: ClassVar[Mapping[str, str]] = {FEATHERSTONE: "symplectic_euler", **_MUJOCO}
    KERNELS: ClassVar[tuple[str, ...]] = (
        "newton._src.sim.articulation",
        "newton._src.solvers.featherstone.kernels",
        "newton._src.solvers.mujoco.kernels",
    )
    """Modules whose kernels come with derivatives, which take most of the time to compile."""

    @classmethod
    def settable(cls, integrator: str) -> tuple[str, ...]:
        """Those of MuJoCo's solver that Newton takes; Featherstone's method has none."""
        return SETTABLE if integrator in _MUJOCO else ()

    def open(self) -> None:
        """Load Newton, and MuJoCo Warp where its solver is asked for."""
        self._newton = load("newton", self.name)
        if self.integrator in _MUJOCO:
            self._mujoco, self._mjw = load("mujoco", self.name), load("mujoco_warp", self.name)

    def worlds(self, count: int, mechanism: Mechanism) -> Worlds:
        """A model of ``count`` worlds and its solver, which begins every step from nothing."""
        model = self._model(count, mechanism)
        solver = self._solver(model)
        now, then, control = model.state(), model.state(), model.control()
        constraints = None
        if self.integrator in _MUJOCO:
            constraints = constraint_solver(self._mjw, solver.mjw_model, solver.mjw_data)
            read = self.settings_of(self._mujoco, solver.mj_model)
            self.settings = {**read, **constraints.limits}

        def step() -> None:
            if constraints is not None:
                solver.mjw_data.qacc_warmstart.zero_()
            solver.step(now, then, control, None, self.dt)
            self._warp.copy(now.joint_q, then.joint_q)
            self._warp.copy(now.joint_qd, then.joint_qd)

        memory = (now.joint_q, now.joint_qd, control.joint_f)
        q, v, force = (x.numpy().reshape(count, -1) for x in memory)
        return Worlds(q, v, force, step, (model, solver, now, then, control), constraints)

    def stop_parameters(self) -> dict[str, Any]:
        """`limit_ke` and `limit_kd` of the limited joint."""
        joint = self._builder().default_joint_cfg
        return {"limit_ke": joint.limit_ke, "limit_kd": joint.limit_kd}

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix of the solver, and all of the generalized force."""
        _, solver, *_ = self.started(q).simulation
        if self.integrator in _MUJOCO:
            constraints = solver.mj_model, solver.mjw_model, solver.mjw_data
            with self.here():
                return forces_at_rest(self._mujoco, self._mjw, *constraints, q)
        mass, force = (np.array(x.numpy(), np.float64) for x in (solver.H, solver.joint_tau))
        return mass.reshape(len(q), -1), force.reshape(-1)[: len(q)]

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
            **self.settings,
        )

    def _model(self, count: int, mechanism: Mechanism) -> Any:
        """As many equal worlds; inertias are kept as they are given."""
        one, all_of_them = self._builder(), self._builder()
        parent, joints = -1, []
        for link, offset in zip(mechanism.links, mechanism.offsets, strict=True):
            body = one.add_link(
                mass=link.mass,
                com=self._warp.vec3(0.0, 0.0, link.centre),
                inertia=self._warp.mat33(np.diag([max(moment(link), LEAST_INERTIA)] * 3)),
            )
            slides = link.joint == "slide"
            add = one.add_joint_prismatic if slides else one.add_joint_revolute
            joint = add(
                parent,
                body,
                parent_xform=self._warp.transform((0.0, 0.0, offset), self._warp.quat_identity()),
                axis=self._warp.vec3(*map(float, link.axis)),
                damping=link.damping,
                armature=0.0,
                friction=0.0,
                limit_lower=None if link.limit is None else -link.limit,
                limit_upper=link.limit,
            )
            joints.append(joint)
            parent = body
        one.add_articulation(joints)
        for _ in range(count):
            all_of_them.add_world(one)
        return all_of_them.finalize(skip_all_validations=True)

    def _builder(self) -> Any:
        newton = self._newton
        down = (0.0, 0.0, -self.mechanism.gravity)
        return newton.ModelBuilder(up_axis=newton.Axis.Z, gravity=down)

    @contextmanager
    def here(self) -> Iterator[None]:
        """Warp at work on the CPU, without a word, its kernels without their derivatives.

        Kernels are compiled as they are used here; derivatives can still be had.
        """
        options, warp = "enable_backward", self._warp
        with super().here():
            kept = [warp.get_module_options(module=name)[options] for name in self.KERNELS]
            for name in self.KERNELS:
                warp.set_module_options({options: False}, module=name)
            try:
                yield
            finally:
                for name, value in zip(self.KERNELS, kept, strict=True):
                    warp.set_module_options({options: value}, module=name)
