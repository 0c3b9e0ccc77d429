"""MuJoCo Warp."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from integ_gym.support.packages.extras import load

from ..mechanics import Mechanism
from ..ops.ops import Components
from .rigid import (
    LEAST_INERTIA,
    MAPS,
    Array,
    mjcf,
    stop_law,
)
from .warp import (
    ROWS,
    WarpEngine,
    Worlds,
    constraint_solver,
    forces_at_rest,
)


class MujocoWarpEngine(WarpEngine):
    """`mujoco_warp.step`, in float32, on the CPU; all lanes of a vector environment at once.

    Its integrators are MuJoCo's; see :class:`integ_gym.envs.engines.mujoco.MujocoEngine`.
    With its own stops it reports as MuJoCo does; a step without a constraint takes its solver one
    iteration.
    """

    name: ClassVar[str] = "mujoco_warp"
    package: ClassVar[str] = "mujoco-warp"
    modules: ClassVar[tuple[str, ...]] = ("mujoco", "mujoco_warp", "warp")
    least_inertia: ClassVar[float] = LEAST_INERTIA
    maps: ClassVar[Mapping[str, str]] = MAPS

    def open(self) -> None:
        """Load MuJoCo and MuJoCo Warp."""
        self._mujoco = load("mujoco", self.name)
        self._mjw = load("mujoco_warp", self.name)

    def worlds(self, count: int, mechanism: Mechanism) -> Worlds:
        """One model, with data for ``count`` worlds."""
        made = self._compiled(mechanism)
        model = self._mjw.put_model(made)
        data = self._mjw.make_data(made, nworld=count, nconmax=0, njmax=ROWS)

        def step() -> None:
            data.qacc_warmstart.zero_()
            self._mjw.step(model, data)

        q, v, force = (x.numpy() for x in (data.qpos, data.qvel, data.qfrc_applied))
        solver = constraint_solver(self._mjw, model, data)
        return Worlds(q, v, force, step, (made, model, data), solver)

    def stop_parameters(self) -> dict[str, Any]:
        """`solref` and `solimp` of the limited joint."""
        return stop_law(self._compiled(self.mechanism), self.system.engine_stops)

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix by the composite rigid body algorithm, and all of the generalized force."""
        made, model, data = self.started(q).simulation
        with self.here():
            return forces_at_rest(self._mujoco, self._mjw, made, model, data, q)

    def _compiled(self, mechanism: Mechanism) -> Any:
        """MuJoCo's model; MuJoCo Warp has no automatic reset, and does not know its flag."""
        text = mjcf(mechanism, self.dt, self.integrator)
        model = self._mujoco.MjModel.from_xml_string(text)
        model.opt.disableflags &= ~int(self._mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        return model
