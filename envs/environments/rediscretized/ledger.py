"""The energy ledger of a MuJoCo model, sub-step by sub-step."""

from __future__ import annotations

from math import nan
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

TAKEN_AT_THE_END = ("Euler", "implicit", "implicitfast", "discrete")
"""Integrators that take joint damping at the end of the step: its work is force · displacement."""


FASTEST = 1e6
"""A velocity component beyond this, m/s or rad/s, is a divergence."""


_NOT_BOOKED = (
    "body_gravcomp", "tendon_damping", "tendon_dampingpoly", "dof_dampingpoly",
    "actuator_damping", "actuator_dampingpoly",
)  # fmt: skip
"""Parameters of a model, where its MuJoCo has them, of losses that are not accounted for."""


class Booked(NamedTuple):
    """What one control period brought, J."""

    work: float
    dissipated: float
    """NaN where a loss is not accounted for."""
    constrained: bool
    """Whether a contact, joint limit or other constraint acted in any sub-step."""
    iterations: int
    """Most solver iterations of any sub-step."""
    penetration: float
    """Deepest contact where the forces of any sub-step were last computed, m: at its beginning,
    under RK4 at its end."""
    violation: float
    """Largest violation of any constraint there, m or rad."""


NOTHING = Booked(0.0, 0.0, False, 0, 0.0, 0.0)


class Ledger:
    """Books the work of the actuators and the losses of a model while it is stepped.

    Work is the generalized force of the actuators times the displacement, which is exact where the
    force does not depend on the state within a step, as that of a motor. What damping takes is
    known for integrators that take it at the end of the step; losses in a fluid, a tendon or an
    actuator, by gravity compensation or by powers of the speed are not accounted for. Of RK4's four
    stages MuJoCo tells the constraints of the last alone: a step that ends where it would without
    any constraint had none in the others.

    Args:
        mujoco: the module.
        model: compiled model.
        integrator: MuJoCo's name of its integrator.
    """

    def __init__(self, mujoco: Any, model: Any, integrator: str) -> None:
        self._mujoco, self._model = mujoco, model
        self._scratch = mujoco.MjData(model)
        self._displacement = np.zeros(model.nv)
        self._damping = np.array(model.dof_damping).reshape(model.nv, -1)[:, 0]
        self.accounted = _accounted(model, integrator)
        self._staged = self.accounted and integrator == "RK4"

    def energy(self, data: Any) -> float:
        """Kinetic plus potential energy, J, zero where MuJoCo has it."""
        scratch, model, mujoco = self._scratch, self._model, self._mujoco
        scratch.qpos[:], scratch.qvel[:] = data.qpos, data.qvel
        mujoco.mj_kinematics(model, scratch)
        mujoco.mj_comPos(model, scratch)
        mujoco.mj_tendon(model, scratch)
        mujoco.mj_makeM(model, scratch)
        mujoco.mj_energyPos(model, scratch)
        mujoco.mj_energyVel(model, scratch)
        return float(scratch.energy.sum())

    def step(self, data: Any, count: int) -> Booked:
        """Take ``count`` steps, or as many as there are until the motion has diverged."""
        work = lost = depth = violation = 0.0
        constrained, iterations = False, 0
        for _ in range(count):
            before = data.qpos.copy()
            constrained |= self._taken(data)
            if is_lost(data):
                break
            moved = self._displacement
            self._mujoco.mj_differentiatePos(self._model, moved, 1.0, before, data.qpos)
            work += float(data.qfrc_actuator @ moved)
            lost += float((self._damping * data.qvel) @ moved)
            if data.nefc:
                iterations = max(iterations, int(data.solver_niter.max()))
                violation = max(violation, -float(data.efc_pos.min()))
            if data.ncon:
                depth = max(depth, -float(data.contact.dist.min()))
        lost = lost if self.accounted else nan
        return Booked(work, lost, constrained, iterations, depth, violation)

    def put_back(self, booked: Booked) -> Booked:
        """What is booked of a control period whose motion was taken back."""
        lost = 0.0 if self.accounted else nan
        return NOTHING._replace(
            dissipated=lost, constrained=booked.constrained, iterations=booked.iterations
        )

    def _taken(self, data: Any) -> bool:
        """Take one step; whether a constraint acted in it."""
        mujoco, model, free = self._mujoco, self._model, self._scratch
        if self._staged:
            mujoco.mj_copyData(free, model, data)
        mujoco.mj_step(model, data)
        if data.nefc or not self._staged:
            return bool(data.nefc)
        flags = model.opt.disableflags
        model.opt.disableflags = flags | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        mujoco.mj_step(model, free)
        model.opt.disableflags = flags
        return bool((free.qpos != data.qpos).any() or (free.qvel != data.qvel).any())


def is_lost(data: Any) -> bool:
    """Whether the motion has diverged."""
    finite = np.isfinite(data.qpos).all()
    return not (finite and bool((np.abs(data.qvel) <= FASTEST).all()))


def _accounted(model: Any, integrator: str) -> bool:
    """Whether every loss of the model is joint damping that the ledger knows."""
    elsewhere = (
        model.opt.density > 0.0
        or model.opt.viscosity > 0.0
        or any(np.any(getattr(model, name, 0.0)) for name in _NOT_BOOKED)
    )
    damped = bool(np.any(model.dof_damping))
    return not elsewhere and (not damped or integrator in TAKEN_AT_THE_END)
