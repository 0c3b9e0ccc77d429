"""Many robots of one testbed side by side: stepped one after the other, judged together.

Imported where they are made: they need MuJoCo.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from gymnasium.vector.utils import batch_space

from integ_gym.support.errors import InputError

from ..foreign import FURTHER, SequentialVectorEnv, time_limit
from ..lanes import as_floats, lane_seeds, mask_names
from ..mujoco_ledger import NOTHING, Booked, Readings
from ..ops.ops import Array, join_state
from ..transition import DIVERGED, NOT_CONVERGED, OK, STATUS_NAMES
from .mjcf import Memory
from .mjcf_batch import ROOM, BatchSteps, steps_in_batch
from .mjcf_env import Acting, MjcfEnv

_WORDS = np.array(STATUS_NAMES, dtype=object)

RAGGED: Final = ("contact", "efc_", "iefc_", "solver", "warning", "timer")
"""How names of fields begin that lanes have not of one size."""


class LaneData:
    """Fields of an `MjData` as several lanes have them, of shape (lanes, …), by their names.

    Args:
        mujoco: the module.
        model: compiled.
        data: holds the state of one lane after the other.
        states: of all, as `mj_getState` gives what a step begins with, shape (lanes, numbers).
    """

    def __init__(self, mujoco: Any, model: Any, data: Any, states: Array) -> None:
        self._mujoco, self._model, self._data = mujoco, model, data
        self._states, self._whole = [*states], int(mujoco.mjtState.mjSTATE_INTEGRATION)
        self.rows = _state_fields(mujoco, model, data, states)
        self._kept: list[tuple[Any, Array]] = []

    def __getattr__(self, name: str) -> Array:
        if name.startswith("__"):  # as copying asks
            raise AttributeError(name)
        if name not in self.rows:
            field = getattr(self._data, name, None)
            if not isinstance(field, np.ndarray) or name.startswith(RAGGED):
                raise InputError(
                    f"`robot.data.{name}` is not there for many robots at once; use what is an "
                    "array of one size, such as `xpos`, or leave out `together = True`"
                )
            self.rows[name] = np.zeros((len(self._states), *field.shape), field.dtype)
            for lane in range(len(self._states)):
                self.put(lane)
                self._mujoco.mj_forward(self._model, self._data)
                self.rows[name][lane] = field
            self._kept.append((field, self.rows[name]))
        shown = self.rows[name].view()
        shown.setflags(write=False)
        return shown

    def put(self, lane: int) -> None:
        """Put a lane's state into the data."""
        self._mujoco.mj_setState(self._model, self._data, self._states[lane], self._whole)

    def take(self, lane: int) -> None:
        """Take a lane's state from the data."""
        self._mujoco.mj_getState(self._model, self._data, self._states[lane], self._whole)

    def keep(self, lane: int) -> None:
        """Keep what else is read of a lane as it is in the data, where `mj_forward` was called."""
        for field, rows in self._kept:
            rows[lane] = field


def _state_fields(mujoco: Any, model: Any, data: Any, states: Array) -> dict[str, Array]:
    """Parts of some data's states, by the names of its fields."""
    fields, begin = {}, 0
    kinds = {int(k): n for n, k in mujoco.mjtState.__members__.items() if n.startswith("mjSTATE")}
    for kind in sorted(kind for kind in kinds if kind.bit_count() == 1):
        name = kinds[kind].removeprefix("mjSTATE_").lower()
        name = {"warmstart": "qacc_warmstart", "plugin": "plugin_state"}.get(name, name)
        end = begin + mujoco.mj_stateSize(model, kind)
        shape = np.shape(getattr(data, name))
        fields[name], begin = states[:, begin:end].reshape(len(states), *shape), end
    return fields


class ActingTogether(Acting):
    """Robots whose testbed takes many at once.

    Args:
        task: of one of them.
        data: of all.
        commands: of each, shape (lanes, commands).
    """

    def __init__(self, task: Any, data: LaneData, commands: Array) -> None:
        self.testbed, self.period, self.bounds = task.testbed, task.period, task.bounds
        self.robot, self.command = copy.copy(task.robot), commands
        self.decisions, self.squares = 0, np.zeros(len(commands))
        self.robot.data = data
        idle = np.zeros((len(commands), *task.action_space.shape))
        self.memory = Memory(last_action=idle, time=np.zeros(len(commands)))


class RobotLanes(SequentialVectorEnv):
    """Robots of a testbed in one discretization, each to the last bit as it is alone.

    One after the other is stepped in the same `MjData`, which a processor's cache holds; what is
    read there is booked for all of them together, and the testbed's methods are called once for
    all. Lanes that have ended rest until they are reset.

    Args:
        make: makes the environment in which all are stepped.
        num_envs: how many.
        autoreset_mode: ``DISABLED``.
    """

    def __init__(self, make: Callable[[], MjcfEnv], num_envs: int, autoreset_mode: Any) -> None:
        super().__init__(make, 1, autoreset_mode)
        self.num_envs = n = num_envs
        self.observation_space = batch_space(self.single_observation_space, n)
        self.action_space = batch_space(self.single_action_space, n)
        self._env: MjcfEnv = self._tasks[0]
        self._task = self._env.unwrapped
        self._model, self._mujoco = self._env.model, self._env.mujoco
        data, timing = self._task.data, self._env.setup.timing
        self._data = data
        of_all = n, timing.substeps
        self._batch: BatchSteps | None = None
        if steps_in_batch(self._mujoco, self._model):
            sensing = self._task.testbed.sensing
            self._batch = BatchSteps(self._mujoco, self._model, sensing, *of_all)
            states, self._readings = self._batch.states, Readings(self._model, data, *of_all, ROOM)
        else:
            whole = int(self._mujoco.mjtState.mjSTATE_INTEGRATION)
            states = np.zeros((n, self._mujoco.mj_stateSize(self._model, whole)))
            self._readings = Readings(self._model, data, *of_all)
        self._lane_data = LaneData(self._mujoco, self._model, data, states)
        self._period, self._horizon = timing.control_period, timing.horizon
        self._limit = time_limit(self._env) or math.inf
        self._flags = int(self._model.opt.disableflags)
        self._quiet = self._flags | self._env.needless_sensors
        self._order = [*join_state((*range(data.qpos.size),), (*range(-data.qvel.size, 0),))]
        self._random: list[Any] = [(None, None)] * n
        self._goals = [copy.copy(self._env.goal) for _ in range(n)]
        self._looks: list[Any] = [None] * n
        self._commands = np.zeros((n, *self._task.command.shape))
        self._terminations, self._truncations = np.zeros(n, bool), np.zeros(n, bool)
        self._steps, self._diverged = np.zeros(n, np.int64), np.zeros(n, bool)
        self._energies = np.zeros((n, 2))
        self._energy, self._least, self._earned = np.zeros(n), np.zeros(n), np.zeros(n)
        self._control = np.zeros((n, len(self._env.setup.plant.controls)))
        self._booked = _empty_booking(n)
        self._seen = np.zeros((n, *np.shape(self._task.see())))
        self._last: dict[str, Array] = {}

    @property
    def np_random_seed(self) -> tuple[Any, ...]:  # type: ignore[override]
        """Of every lane."""
        return tuple(seed for _, seed in self._random)

    @property
    def state(self) -> Array:
        """See :class:`DiscretizedVectorEnv`."""
        rows = self._lane_data.rows
        whole: Array = np.concatenate([rows["qpos"], rows["qvel"]], axis=1)[:, self._order]
        return whole

    @property
    def state_components(self) -> Array:
        """See :class:`DiscretizedVectorEnv`."""
        return self.state.T

    @property
    def status_codes(self) -> Array:  # type: ignore[override]
        """See :class:`DiscretizedVectorEnv`."""
        capped = self._booked.iterations >= self._env.setup.engine.solver_cap
        return np.where(self._diverged, DIVERGED, np.where(capped, NOT_CONVERGED, OK))

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Start episodes in all lanes, or in some while none of the others goes on.

        Raises:
            ValueError: if another goes on.
        """
        n, task = self.num_envs, self._task
        options = dict(options or {})
        begun = np.array(options.pop("reset_mask", np.ones(n, bool)))
        if not (begun | self._terminations | self._truncations).all():
            raise InputError("robots that act together begin together; reset those that go on, too")
        info: dict[str, Any] = {}
        for lane, own in enumerate(lane_seeds(seed, n)):
            if not begun[lane]:
                continue
            task._np_random, task._np_random_seed = self._random[lane]
            self._seen[lane], own_info = self._env.reset(seed=own, options=options or None)
            self._random[lane] = task._np_random, task._np_random_seed
            info = self._add_info(info, own_info, lane)
            self._goals[lane].begin()
            self._commands[lane] = task.command
            self._energy[lane], self._control[lane] = self._env.start
            self._lane_data.take(lane)
            self._lane_data.keep(lane)
            self._looks[lane] = self._env.figures.look(self._readings.contacts)
        for values in (self._steps, self._least, self._earned, self._diverged):
            values[begun] = 0
        self._terminations[begun] = self._truncations[begun] = False
        self._booked = _select(begun, _empty_booking(n), self._booked)
        commands = self._commands.copy()
        commands.setflags(write=False)
        self._acting = ActingTogether(task, self._lane_data, commands)
        return self._seen.copy(), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Advance every lane that has not ended by one control period."""
        live = ~(self._terminations | self._truncations)
        asked = as_floats(actions)
        valid: Any = np.isfinite(asked).all(axis=1)
        command = np.where(valid[:, None], asked, self._control)
        given = command.astype(self.single_action_space.dtype)
        energies = self._simulate(live, self._acting.decide(given))
        before, booked, diverged = self._energy, self._booked, self._diverged
        self._energy = np.where(live & ~diverged, energies, before)
        seen, reward, fallen = self._acting.judge()
        self._steps = steps = self._steps + live
        lost = self._least * (self._horizon - steps + 1) - np.maximum(0.0, self._earned)
        rewards = np.where(live, np.where(diverged, lost, reward), 0.0)
        new = (live & ~diverged)[:, None]
        self._seen = seen if new.all() else np.where(new, seen, self._seen)
        self._least = np.minimum(self._least, rewards)
        self._earned = self._earned + rewards
        self._terminations = np.where(live, fallen | diverged, self._terminations)
        self._truncations = np.where(live, steps >= self._limit, self._truncations)
        low, high = self._env.command_bounds
        self._control = np.minimum(np.maximum(command, low), high)
        residual = self._energy - before - booked.work + booked.dissipated
        entries = {
            **self._outcomes(live, rewards),
            "fallback_used": ~valid,
            "energy_residual": np.where(booked.constrained, math.nan, residual),
            **self._applied(valid, given),
        }
        ends = self._terminations.copy(), self._truncations.copy()
        return self._seen.copy(), rewards, *ends, self._info(live, entries)

    def _simulate(self, live: Array, controls: Array) -> Array:
        """One control period of the lanes that go on; the energy at its end, J."""
        mujoco, ledger, readings = self._mujoco, self._env.ledger, self._readings
        model, data, flags, quiet = self._model, self._data, self._flags, self._quiet
        lane_data, look = self._lane_data, self._env.figures.look
        options, energy, energies = model.opt, data.energy, self._energies
        self._env.silence()
        lanes = np.flatnonzero(live)
        lane_data.rows["ctrl"][lanes] = controls[lanes]
        alone = {*(lanes if self._batch is None else self._batch.take(readings, lanes)).tolist()}
        for lane in lanes.tolist():
            lane_data.put(lane)
            if lane in alone:
                options.disableflags = quiet
                is_whole = ledger.follow(readings, lane)
                options.disableflags = flags
                if not is_whole:
                    data.qpos[:], data.qvel[:] = readings.start
                lane_data.take(lane)
            mujoco.mj_forward(model, data)
            mujoco.mj_energyPos(model, data)
            mujoco.mj_energyVel(model, data)
            energies[lane] = energy
            lane_data.keep(lane)
            self._looks[lane] = look(readings.contacts)
        self._diverged = np.where(live, readings.lost, self._diverged)
        booked, diverged = ledger.book(readings, lanes), self._diverged[lanes]
        if diverged.any():
            booked = _select(diverged, ledger.put_back(booked), booked)
        self._booked = Booked(*(own.copy() for own in self._booked))
        for own, new in zip(self._booked, booked, strict=True):
            own[lanes] = new
        return energies[:, 0] + energies[:, 1]

    def _outcomes(self, live: Array, rewards: Array) -> dict[str, Array]:
        """Time, success, and since when the goal has been met."""
        n, time = self.num_envs, self._steps * self._period
        success, since = np.zeros(n, bool), np.zeros(n)
        ended = self._terminations | self._truncations
        columns = (x.tolist() for x in (rewards, self._terminations, self._truncations, time))
        for lane, (goal, *outcome) in enumerate(zip(self._goals, *columns, strict=True)):
            if live[lane]:
                if ended[lane]:
                    self._hand_over(lane)
                success[lane] = goal.note(*outcome) and not self._diverged[lane]
                since[lane] = goal.since
        return {"time": time, "sensor_time": time.copy(), "goal_since": since, "success": success}

    def _hand_over(self, lane: int) -> None:
        """Have the one task be that of a lane, as what it achieves is asked of it."""
        acting = self._acting
        self._lane_data.put(lane)
        self._mujoco.mj_forward(self._model, self._data)
        self._task.command, self._task.squares = acting.command[lane], acting.squares[lane]
        self._task.decisions = acting.decisions
        for name, value in vars(acting.memory).items():
            setattr(self._task.memory, name, value[lane] if np.ndim(value) else value)

    def _applied(self, valid: Array, given: Array) -> dict[str, Array]:
        """Actions as they were asked for and applied, side by side, and whether at a bound."""
        (low, high), (first, last) = self._env.command_bounds, self._env.command_ends
        applied = np.minimum(np.maximum(given.astype(np.float64), low), high)
        at_bounds = ((applied <= first) | (applied >= last)).any(axis=1)
        controls = np.concatenate([self._control, applied], axis=1)
        return {"controls": controls, "saturated": valid & at_bounds}

    def _info(self, live: Array, entries: dict[str, Array]) -> dict[str, Any]:
        """`info` of all lanes."""
        n, booked, acting = self.num_envs, self._booked, self._acting
        entries |= {
            "energy": self._energy,
            "actuator_work": booked.work,
            "dissipated": booked.dissipated,
            "clip_loss": np.zeros(n),
            "penetration": booked.penetration,
            "constraint_violation": booked.violation,
            "solver_iterations": booked.iterations,
            "solver_residual": np.zeros(n),
            "solver_status": _WORDS[self.status_codes],
            "command": acting.command.copy(),
            FURTHER: self._env.figures.read(
                self._looks, self._lane_data, acting.command, acting.measure()
            ),
        }
        if not live.all():
            for name, values in entries.items():
                own = live[:, None] if values.ndim > 1 else live
                entries[name] = np.where(own, values, self._last[name])
        self._last = dict(entries)
        entries |= zip(self._env.control_entries, entries.pop("controls").T, strict=True)
        masks = dict.fromkeys(mask_names(tuple(entries)), np.ones(n, bool))
        for name in ("dissipated", "energy_residual"):
            masks[f"_{name}"] = ~np.isnan(entries[name])
        return {**entries, **masks}


def _empty_booking(lanes: int) -> Booked:
    return Booked(*(np.full(lanes, value) for value in NOTHING))


def _select(lanes: Array, booked: Booked, other: Booked) -> Booked:
    """What is booked of some lanes, and of the others by another."""
    return Booked(*(np.where(lanes, *both) for both in zip(booked, other, strict=True)))
