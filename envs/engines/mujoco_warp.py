"""MuJoCo Warp."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from integ_gym.support import load

from ..arithmetic import Components
from ..mechanics import Stops
from ._rigid import LEAST_INERTIA, MAPS, Array, mjcf
from ._warp import ROWS, WarpEngine, Worlds, constraint_solver, mass_matrix


class MujocoWarpEngine(WarpEngine):
    """`mujoco_warp.step`, in float32, on the CPU; all lanes of a vector environment at once.

    Its integrators are MuJoCo's; see :class:`integ_gym.envs.engines.mujoco.engine.MujocoEngine`.
    With its own stops it reports as MuJoCo does; a step without a constraint takes its solver one
    iteration.
    """

    name: ClassVar[str] = "mujoco_warp"
    package: ClassVar[str] = "mujoco-warp"
    modules: ClassVar[tuple[str, ...]] = ("mujoco", "mujoco_warp", "warp")
    extra: ClassVar[str] = "mujoco_warp"
    own_stops: ClassVar[bool] = True
    least_inertia: ClassVar[float] = LEAST_INERTIA
    maps: ClassVar[Mapping[str, str]] = MAPS

    def open(self) -> None:
        """Load MuJoCo and MuJoCo Warp."""
        self._mujoco = load("mujoco", self.extra)
        self._mjw = load("mujoco_warp", self.extra)

    def worlds(self, count: int, stops: Stops | None) -> Worlds:
        """One model, with data for ``count`` worlds."""
        made = self._compiled(stops)
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
        stops = self.system.engine_stops
        assert stops is not None
        model = self._compiled(stops)
        solref, solimp = model.jnt_solref[stops.coordinate], model.jnt_solimp[stops.coordinate]
        return {"solref": solref.tolist(), "solimp": solimp.tolist()}

    def inertia(self, q: Components) -> Array:
        """Mass matrix by the composite rigid body algorithm."""
        made, _, data = self._forward(q)
        return mass_matrix(self._mujoco, made, data)

    def gravity(self, q: Components) -> Array:
        """Minus the bias force at rest."""
        _, _, data = self._forward(q)
        return -np.array(data.qfrc_bias.numpy()[0], dtype=np.float64)

    def _forward(self, q: Components) -> Any:
        """Model, and data of one world at rest in ``q``."""
        made, model, data = self.started(q).simulation
        data.qpos.assign([q])
        data.qvel.zero_()
        with self.here():
            self._mjw.forward(model, data)
        return made, model, data

    def _compiled(self, stops: Stops | None) -> Any:
        """MuJoCo's model; MuJoCo Warp has no automatic reset, and does not know its flag."""
        model = self._mujoco.MjModel.from_xml_string(
            mjcf(self.mechanism, self.dt, self.integrator, stops)
        )
        model.opt.disableflags &= ~int(self._mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        return model
