"""Control periods of many robots by MuJoCo's batch, which steps them without the interpreter.

Imported where robots are stepped: it needs MuJoCo.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from integ_gym.support.optional import load, not_installed

from ..mujoco_ledger import FASTEST, Readings
from ..ops.ops import Array
from .making import ENGINE

_BATCH = "mujoco.batch"

_RECORDED = ("qfrc_actuator", "solver_niter", "nefc", "sensordata")
"""Fields of `MjData` that are read after each timestep, beside positions and velocities."""

ROOM = (1, 1)
"""For what is kept of contacts and constraints: the least alone."""


def steps_in_batch(mujoco: Any, model: Any) -> bool:
    """Whether a batch steps a model, and tells all that :class:`Readings` keep of it.

    It does not show constraints. So these may be contacts that act, whose least distance a sensor
    tells, limits of joints with one coordinate, which positions tell, and dry friction. RK4's
    contacts are those of its last stage, and the sensor tells those of the first.
    """
    if not_installed([_BATCH]):
        return False
    option, flag, joint = model.opt, mujoco.mjtDisableBit, mujoco.mjtJoint
    ball = model.jnt_type < int(joint.mjJNT_SLIDE)
    others = model.neq or model.nflex or model.nhistory or model.tendon_limited.any()
    others = others or model.jnt_limited[ball].any()
    others = others or model.geom_gap.any() or model.pair_gap.any()
    names = ("CONSTRAINT", "CONTACT", "LIMIT", "SENSOR")
    off = sum(int(getattr(flag, f"mjDSBL_{name}")) for name in names)
    changed = option.enableflags or option.disableflags & off
    hooks = [getattr(mujoco, name)() for name in dir(mujoco) if name.startswith("get_mjcb_")]
    staged = option.integrator == int(mujoco.mjtIntegrator.mjINT_RK4)
    return not (others or changed or staged or any(hooks))


class BatchSteps:
    """A control period of many robots at once.

    Args:
        mujoco: the module.
        model: compiled, in a discretization.
        sensing: the same motion, with another sensor and without what only shows; see
            :func:`integ_gym.envs.testbeds.mjcf_model.compile_sensing`.
        lanes: how many.
        count: timesteps in a control period.

    Attributes:
        states: of the lanes, as `mj_getState` gives what a step begins with.
    """

    def __init__(self, mujoco: Any, model: Any, sensing: Any, lanes: int, count: int) -> None:
        self._module, own = load(_BATCH, ENGINE), copy.copy(sensing)
        for name in (name for name in dir(model.opt) if not name.startswith("_")):
            setattr(own.opt, name, getattr(model.opt, name))
        self._batch = self._module.Batch(own, lanes, nthread=1)
        self._count, self.states = count, self._batch.state
        self._q, self._v = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._warnings = self._batch.warning[..., 1]
        kinds = mujoco.mjtState
        self._motion = int(kinds.mjSTATE_QPOS | kinds.mjSTATE_QVEL)
        limited = np.flatnonzero(model.jnt_limited)
        self._places = model.jnt_qposadr[limited]
        self._low, self._high = model.jnt_range[limited].T

    def take(self, readings: Readings, lanes: Array) -> Array:
        """Take all timesteps of some lanes and read each.

        Args:
            readings: with :data:`ROOM`.
            lanes: their numbers, ascending.

        Returns:
            Of these lanes those whose motion may have diverged, or of which MuJoCo warns: their
            states are as before, and they are to be stepped one by one.
        """
        before, self._warnings[:] = self.states.copy(), 1  # so that none is written
        own = slice(None) if len(lanes) == len(before) else lanes
        q, v, nq = readings["q"], readings["v"], self._q.shape[1]
        q[own, 0], v[own, 0] = self._q[own], self._v[own]
        record, ids = (self._motion, *_RECORDED), lanes.astype(np.int32)
        try:
            found = self._batch.rollout(self._count, record=record, ids=ids)
        except self._module.SimulationError:
            self.states[:] = before
            return lanes
        motion, acting = found[self._motion], found["nefc"] > 0
        q[own, 1:], v[own, 1:] = motion[..., :nq], motion[..., nq:]
        readings["force"][own] = found["qfrc_actuator"]
        readings.used[own] = np.where(acting[..., None], found["solver_niter"], 0)
        readings.taken[own], readings.constrained[own] = self._count, acting.any(axis=1)
        nearest = found["sensordata"][..., 1]
        nearest[found["sensordata"][..., 0] == 0.0] = np.inf
        begun = q[own][:, :-1, self._places]
        within = np.minimum(begun - self._low, self._high - begun).min(axis=2, initial=np.inf)
        readings["distances"][own, :, 0] = nearest
        readings["positions"][own, :, 0] = np.minimum(nearest, within)
        is_sound = (np.abs(motion) <= FASTEST).all(axis=(1, 2))
        follow: Array = lanes[~(is_sound & (self._warnings[lanes] == 1).all(axis=1))]
        self.states[follow] = before[follow]
        return follow
