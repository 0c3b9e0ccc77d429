"""What MuJoCo's actuators and losses do to the energy of a model while it is stepped."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from .engines.mujoco_solver import NO_RESET, was_reset
from .ops.ops import Array

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
    """What one control period brought, J: numbers, or arrays of one for each lane."""

    work: Any
    dissipated: Any
    """NaN where a loss is not accounted for."""
    constrained: Any
    """Whether a contact, joint limit or other constraint acted in any sub-step."""
    iterations: Any
    """Most solver iterations of any sub-step."""
    penetration: Any
    """Deepest contact where the forces of any sub-step were last computed, m: at its beginning,
    under RK4 at its end."""
    violation: Any
    """Largest violation of any constraint there, m or rad."""


def add_up(one: Booked, other: Booked) -> Booked:
    """What two parts of a control period brought together."""
    return Booked(
        one.work + other.work,
        one.dissipated + other.dissipated,
        one.constrained or other.constrained,
        max(one.iterations, other.iterations),
        max(one.penetration, other.penetration),
        max(one.violation, other.violation),
    )


NOTHING = Booked(0.0, 0.0, False, 0, 0.0, 0.0)


class Contacts(dict[int, Any]):
    """Arrays of some data's contacts by how many it has, each made once.

    MuJoCo keeps contacts where its arena begins, so that arrays of as many are the same.

    Args:
        data: an `MjData`; asked for the number of contacts that it has.
    """

    def __init__(self, data: Any) -> None:
        super().__init__()
        self.data = data

    def __missing__(self, count: int) -> Any:
        found = self.data.contact
        self[count] = {name: getattr(found, name) for name in ("dist", "pos", "frame", "geom")}
        return self[count]

    @cached_property
    def gradients(self) -> Any:
        """Scaled gradients after the solver's iterations, island by island."""
        return self.data.solver.gradient


_NEAREST = ("distances", "positions")
"""Of contacts, and of rows of constraints."""


class Readings:
    """What is read of data after each timestep of a control period, lane by lane.

    Every lane is read into the same row, which a processor's cache holds, and kept from there.

    Args:
        model: compiled.
        data: in which the lanes are stepped.
        lanes: how many.
        count: timesteps.
        room: contacts and rows of constraints in a timestep of which all are kept, not the least
            alone.

    Attributes:
        contacts: of the data.
        room: as given.
        start: where to the positions and velocities before the first timestep are read.
        steps: of each timestep, where to forces, positions, velocities, iterations, distances of
            contacts and positions of constraints after it are read.
        used: iterations of the solver, shape (lanes, timesteps, islands).
        taken: timesteps until the motion diverged, of each lane.
        constrained: whether a constraint acted, of each lane.
    """

    def __init__(
        self, model: Any, data: Any, lanes: int, count: int, room: tuple[int, int] = (8, 64)
    ) -> None:
        self.contacts, self.room = Contacts(data), room
        self.constrained, self.taken = np.zeros(lanes, bool), np.zeros(lanes, np.int64)
        shapes = {
            "q": (count + 1, model.nq),
            "v": (count + 1, model.nv),
            "force": (count, model.nv),
        }
        shapes |= {name: (count, size) for name, size in zip(_NEAREST, room, strict=True)}
        ends = np.cumsum([0, *(steps * size for steps, size in shapes.values())]).tolist()
        self._row, self._rows = np.zeros(ends[-1]), np.zeros((lanes, ends[-1]))
        one, every = {}, {}
        for (name, shape), begin, end in zip(shapes.items(), ends, ends[1:], strict=False):
            one[name] = self._row[begin:end].reshape(shape)
            every[name] = self._rows[:, begin:end].reshape(lanes, *shape)
        self._every, self._unread = every, self._row[ends[3] :]
        self._used = np.zeros((count, len(data.solver_niter)), np.int32)
        self.used = np.zeros((lanes, *self._used.shape), np.int32)
        self.start = one["q"][0], one["v"][0]
        ends_of_steps = one["q"][1:], one["v"][1:]
        parts = one["force"], *ends_of_steps, self._used, *(one[name] for name in _NEAREST)
        self.steps = [*zip(*parts, strict=True)]

    def __getitem__(self, name: str) -> Array:
        """Of all lanes ``q`` and ``v``, from the start on, ``force``, ``distances`` or
        ``positions``, shape (lanes, timesteps, numbers); infinite where there are fewer."""
        return self._every[name]

    @property
    def lost(self) -> Array:
        """Whether the motion has diverged, of each lane."""
        return self.taken < len(self.steps)

    def begin(self) -> None:
        """Begin to read a lane."""
        self._unread.fill(math.inf)
        self._used.fill(0)

    def keep(self, lane: int, taken: int, constrained: bool) -> None:
        """Keep what was read of a lane."""
        self._rows[lane], self.used[lane] = self._row, self._used
        self.taken[lane], self.constrained[lane] = taken, constrained


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
        self._readings: dict[int, Readings] = {}
        self._resets = not hasattr(mujoco.mjtDisableBit, NO_RESET)
        self._damping = np.array(model.dof_damping).reshape(model.nv, -1)[:, 0]
        self.accounted = _accounts_for_losses(model, integrator)
        self.staged = self.accounted and integrator == "RK4"
        self._step = mujoco.mj_step
        scalar = model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)
        dofs, places = model.jnt_dofadr[scalar], model.jnt_qposadr[scalar]
        self._sliding = _as_slice(dofs), _as_slice(places)
        self._turning = _as_slice(np.setdiff1d(np.arange(model.nv), dofs))

    def take_step_by(self, step: Callable[[Any, Any], None]) -> None:
        """Have another function than `mj_step` advance the data; it tells its last forces there.

        Args:
            step: takes the model and the data.
        """
        self._step, self.staged = step, False

    def note_steps(self, note: Callable[[Any], None]) -> None:
        """Have the data looked at after each step.

        Args:
            note: takes the data.
        """
        step = self._step

        def noted(model: Any, data: Any) -> None:
            step(model, data)
            note(data)

        self._step = noted

    def energy(self, data: Any, computed: bool = False) -> float:
        """Kinetic plus potential energy, J, zero where MuJoCo has it.

        Args:
            data: of a state.
            computed: whether `mj_forward` has been called of this state.
        """
        scratch, model, mujoco = self._scratch, self._model, self._mujoco
        if not hasattr(mujoco, "mj_makeM"):
            scratch.qpos[:], scratch.qvel[:] = data.qpos, data.qvel
            return self._energy_by_forward()
        if not computed:
            scratch.qpos[:], scratch.qvel[:] = data.qpos, data.qvel
            data = scratch
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_tendon(model, data)
            mujoco.mj_makeM(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        potential, kinetic = data.energy.tolist()
        return float(potential + kinetic)

    def _energy_by_forward(self) -> float:
        """The same of the scratch data, where MuJoCo has no `mj_makeM`, as before 3.3.

        MuJoCo 3.1 shows the potential energy in place of the kinetic one.
        """
        scratch, model, mujoco = self._scratch, self._model, self._mujoco
        flags = model.opt.enableflags
        model.opt.enableflags = flags | int(mujoco.mjtEnableBit.mjENBL_ENERGY)
        mujoco.mj_forward(model, scratch)
        model.opt.enableflags = flags
        momentum = np.zeros(model.nv)
        mujoco.mj_mulM(model, scratch, momentum, scratch.qvel)
        return float(scratch.energy[0] + 0.5 * momentum @ scratch.qvel)

    def step(self, data: Any, count: int) -> Booked:
        """Take ``count`` steps, or as many as there are until the motion has diverged.

        Args:
            data: the same at all calls.
            count: of steps.
        """
        if count not in self._readings:
            self._readings[count] = Readings(self._model, data, 1, count)
        readings = self._readings[count]
        self.follow(readings, 0)
        return Booked(*(one.item() for one in self.book(readings)))

    def follow(self, readings: Readings, lane: int) -> bool:
        """Take a lane's steps and read its data after each, until the motion has diverged.

        Args:
            readings: of the data, which have the state of the lane.
            lane: whose it is.

        Returns:
            Whether all steps were taken.
        """
        contacts, model, step = readings.contacts, self._model, self._step
        data, staged, resets = contacts.data, self.staged, self._resets
        q, v, force, used = data.qpos, data.qvel, data.qfrc_actuator, data.solver_niter
        room_of_contacts, room_of_rows = readings.room
        readings.begin()
        first_q, first_v = readings.start
        first_q[:], first_v[:] = q, v
        constrained, taken, fastest = False, 0, FASTEST**2
        for forces, qs, vs, counts, distances, positions in readings.steps:
            if staged:
                constrained |= self._take_step(data)
            else:
                step(model, data)
            rows = data.nefc
            if rows:
                constrained = True
            if (resets or not v.dot(v) <= fastest or not q.dot(q) < math.inf) and self.is_lost(
                data
            ):
                break
            forces[:], qs[:], vs[:] = force, q, v
            taken += 1
            if rows:
                counts[:] = used
                if rows <= room_of_rows:
                    positions[:rows] = data.efc_pos
                else:
                    positions[0] = data.efc_pos.min()
            if touching := data.ncon:
                if touching <= room_of_contacts:
                    distances[:touching] = contacts[touching]["dist"]
                else:
                    distances[0] = contacts[touching]["dist"].min()
        readings.keep(lane, taken, constrained)
        return taken == len(readings.steps)

    def book(self, readings: Readings, lanes: Any = slice(None)) -> Booked:
        """What the steps that were read brought, arrays of one for each lane.

        Args:
            readings: of the lanes.
            lanes: which of them.
        """
        q, v, force = (readings[name][lanes] for name in ("q", "v", "force"))
        is_taken = np.arange(force.shape[1]) < readings.taken[lanes, None]
        moved = self._displacements(q, force)
        work = self._sums(np.vecdot(force, moved), is_taken)
        lost = np.full(len(work), math.nan)
        if self.accounted:
            lost = self._sums(np.vecdot(self._damping * v[:, 1:], moved), is_taken)
        used = readings.used[lanes].max(axis=(1, 2)).astype(np.int64)
        worst = [
            # what is beyond in no timestep is 0.0, and not -0.0
            0.0 + np.fmax.reduce(-readings[name][lanes].min(axis=2), axis=1, initial=0.0)
            for name in _NEAREST
        ]
        return Booked(work, lost, readings.constrained[lanes].copy(), used, *worst)

    def _displacements(self, q: Array, force: Array) -> Array:
        """Between timesteps, as `mj_differentiatePos` has them, where a force or damping acts."""
        moved, (dofs, places), turning = np.zeros_like(force), self._sliding, self._turning
        own = q[..., places]
        moved[..., dofs] = own[:, 1:] - own[:, :-1]
        if self._damping[turning].any() or force[..., turning].any():
            for lane, place in np.ndindex(*force.shape[:2]):
                ends = q[lane, place], q[lane, place + 1]
                self._mujoco.mj_differentiatePos(self._model, moved[lane, place], 1.0, *ends)
        return moved

    def _sums(self, values: Array, is_taken: Array) -> Array:
        """Of each lane, in the order of its timesteps."""
        return 0.0 + np.cumsum(np.where(is_taken, values, 0.0), axis=1)[:, -1]

    def is_lost(self, data: Any) -> bool:
        """Whether the motion has diverged, or MuJoCo reset it, which before 3.2 it always does."""
        q, v = data.qpos, data.qvel
        sound = v.dot(v) <= FASTEST**2 and q.dot(q) < math.inf
        if not sound:  # a sum may overflow, and many components exceed what each may have
            sound = np.isfinite(q).all() and (np.abs(v) <= FASTEST).all()
        return not sound or (self._resets and was_reset(self._mujoco, data))

    def put_back(self, booked: Booked) -> Booked:
        """What is booked of a control period whose motion was taken back."""
        lost = 0.0 if self.accounted else math.nan
        return NOTHING._replace(
            dissipated=lost, constrained=booked.constrained, iterations=booked.iterations
        )

    def _take_step(self, data: Any) -> bool:
        """Take one step of RK4; whether a constraint acted in it."""
        mujoco, model, free = self._mujoco, self._model, self._scratch
        mujoco.mj_copyData(free, model, data)
        self._step(model, data)
        if data.nefc:
            return True
        flags = model.opt.disableflags
        model.opt.disableflags = flags | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        mujoco.mj_step(model, free)
        model.opt.disableflags = flags
        return bool((free.qpos != data.qpos).any() or (free.qvel != data.qvel).any())


def _as_slice(indices: Array) -> Any:
    """Indices that follow each other, as a slice."""
    if len(indices) and (np.diff(indices) == 1).all():
        return slice(int(indices[0]), int(indices[-1]) + 1)
    return indices


def _accounts_for_losses(model: Any, integrator: str) -> bool:
    """Whether every loss of the model is joint damping that the ledger knows."""
    elsewhere = (
        model.opt.density > 0.0
        or model.opt.viscosity > 0.0
        or any(np.any(getattr(model, name, 0.0)) for name in _NOT_BOOKED)
    )
    damped = bool(np.any(model.dof_damping))
    return not elsewhere and (not damped or integrator in TAKEN_AT_THE_END)
