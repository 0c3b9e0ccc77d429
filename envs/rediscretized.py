"""Gymnasium's MuJoCo tasks with another integrator, timestep, control period or delay."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from integ_gym.support.errors import InputError, InputTypeError, SetupError
from integ_gym.support.optional import check_versions, load
from integ_gym.support.parameters import (
    check_values,
    finite_number,
    nonnegative,
    parameter,
    positive,
    probability,
    text,
    unknown_name,
)

from . import foreign
from .delayed import CommandQueue
from .engines.mujoco import silencer
from .engines.mujoco_solver import NO_RESET, read_solver, write_solver
from .environment import at_bounds, within_rounding
from .lanes import as_floats
from .mujoco_ledger import NOTHING, Booked, Ledger, add_up
from .ops.ops import join_state
from .settings import Settings, check_divides, delays_in, timing_of, whole_multiple
from .transition import DIVERGED, NOT_CONVERGED, NOT_REPORTED, OK, STATUS_NAMES

_HEADLESS = ("egl", "osmesa")
"""Values of `MUJOCO_GL` that need no display."""


def no_context(chosen: str | None) -> str:
    """What to do where MuJoCo has no OpenGL context to draw in.

    Args:
        chosen: the environment variable `MUJOCO_GL`.
    """
    failed = "MuJoCo has no OpenGL context to draw in"
    if chosen not in _HEADLESS:
        return (
            f"{failed}; without a display set the environment variable MUJOCO_GL=egl (or osmesa) "
            "before Python starts"
        )
    other = next(name for name in _HEADLESS if name != chosen)
    return (
        f"{failed} with MUJOCO_GL={chosen}; install its library (on Debian libegl1 or libosmesa6), "
        f"or set MUJOCO_GL={other} before Python starts"
    )


_PLACE = (("_x", "m"), ("_y", "m"), ("_z", "m"))
_ATTITUDE = (("_qw", "1"), ("_qx", "1"), ("_qy", "1"), ("_qz", "1"))
_VELOCITY = (("_vx", "m/s"), ("_vy", "m/s"), ("_vz", "m/s"))
_SPIN = (("_wx", "rad/s"), ("_wy", "rad/s"), ("_wz", "rad/s"))
_JOINTS = {
    "slide": ((("", "m"),), (("_dot", "m/s"),)),
    "hinge": ((("", "rad"),), (("_dot", "rad/s"),)),
    "ball": (_ATTITUDE, _SPIN),
    "free": (_PLACE + _ATTITUDE, _VELOCITY + _SPIN),
}
"""By kind of joint: what is put to its name, and the unit, of each coordinate and velocity."""


@dataclass(frozen=True)
class Choice:
    """The arguments of :func:`integ_gym.rediscretize`; None leaves the task as it is.

    Raises:
        ValueError: for a value of another kind or range, with what was expected.
    """

    integrator: str | None = parameter(None, "", "MuJoCo's name", text)
    dt: float | None = parameter(None, "s", "timestep", positive)
    control_period: float | None = parameter(None, "s", "time between two decisions", positive)
    action_latency: float | None = parameter(None, "s", "delay of every command", nonnegative)
    observation_latency: float | None = parameter(None, "s", "age of what is observed", nonnegative)
    latency_jitter: float | None = parameter(None, "s", "most further delay", nonnegative)
    hold_probability: float | None = parameter(None, "1", "that a command is lost", probability)
    success_return: float | None = parameter(None, "", "return of a success", finite_number)

    def __post_init__(self) -> None:
        check_values(Choice, {name: x for name, x in vars(self).items() if x is not None})


def integrator_of(model: Any) -> str:
    """MuJoCo's name of a model's integrator."""
    return next(n for n, number in integrator_numbers().items() if number == model.opt.integrator)


def integrator_numbers() -> dict[str, int]:
    """Integrators of the installed MuJoCo by the names that its model files use."""
    members = load("mujoco", "mujoco").mjtIntegrator.__members__.values()
    capitals = {"euler": "Euler", "rk4": "RK4"}
    names = [member.name.removeprefix("mjINT_").lower() for member in members]
    return {capitals.get(n, n): int(m) for n, m in zip(names, members, strict=True)}


def plant_of(mujoco: Any, model: Any, name: str) -> foreign.ForeignPlant:
    """Names and units of a compiled model's state and controls."""
    kinds = {int(getattr(mujoco.mjtJoint, f"mjJNT_{k.upper()}")): x for k, x in _JOINTS.items()}
    of_q, of_v = [], []
    for index in range(model.njnt):
        joint = model.joint(index).name or f"joint{index}"
        coordinates, velocities = kinds[int(model.jnt_type[index])]
        of_q += [(f"{joint}{suffix}", unit) for suffix, unit in coordinates]
        of_v += [(f"{joint}{suffix}", unit) for suffix, unit in velocities]
    names, units = zip(*of_q, strict=True)
    rates, rate_units = zip(*of_v, strict=True)
    return foreign.ForeignPlant(
        name, tuple(_controls(mujoco, model)), names, units, rates, rate_units, "the model's joints"
    )


def _controls(mujoco: Any, model: Any) -> list[tuple[str, str]]:
    """Name of every actuator, or of its joint; MuJoCo's control has no unit before its gear."""
    on_joint = int(mujoco.mjtTrn.mjTRN_JOINT)
    names: list[str] = []
    for index in range(model.nu):
        name = model.actuator(index).name
        if not name and int(model.actuator_trntype[index]) == on_joint:
            name = model.joint(int(model.actuator_trnid[index, 0])).name
        names.append(name if name and name not in names else f"{name or 'actuator'}{index}")
    return [(f"{name}_control", "1") for name in names]


Array = npt.NDArray[np.float64]


def rediscretize(
    env: gym.Env[Any, Any],
    integrator: str | None = None,
    dt: float | None = None,
    success_return: float | None = None,
    control_period: float | None = None,
    solver: Mapping[str, Any] | None = None,
    action_latency: float | None = None,
    observation_latency: float | None = None,
    latency_jitter: float | None = None,
    hold_probability: float | None = None,
) -> RediscretizedEnv:
    """Change integrator, timestep, control period and delays of a Gymnasium MuJoCo environment.

    The task pays one reward for each control period, by its own formula and with the timestep it
    was made with. At another control period than its own, episodes last as many seconds, and the
    reward is multiplied by the ratio of the periods, so that returns are per second.

    Args:
        env: one that ``gym.make`` made of Gymnasium's MuJoCo environments; it is changed.
        integrator: MuJoCo's name: ``Euler``, ``RK4``, ``implicit``, ``implicitfast``,
            ``discrete``; None: as it is.
        dt: timestep, s; None: as it is.
        success_return: an episode succeeds if its return reaches this; None: if it is not
            terminated, or, of a task whose `reward_threshold` is negative, if it reaches that.
        control_period: s, a whole multiple of the timestep that the task was made with; None: as it
            is.
        solver: settings of MuJoCo's constraint solver that change, such as ``{"iterations": 1,
            "cone": "elliptic", "refsafe": False}``; see
            :data:`integ_gym.envs.engines.mujoco_solver.SETTINGS`.
        action_latency: s, a whole multiple of the timestep: every command acts so much later; until
            the first one arrives, zeros do. The task is given the command that acts at the end of
            the control period, which its reward may charge for.
        observation_latency: s, a whole multiple of the timestep: what is observed is so old; until
            the first arrives, the start is. Rewards and ends are of the state as it is.
        latency_jitter: s, a whole multiple of the timestep: most by which a command is later than
            that, drawn for each by the seed of the episode.
        hold_probability: that a command does not arrive, drawn likewise: the one before it holds.

    Raises:
        TypeError: for another environment.
        ValueError: for an unknown integrator, a timestep of which the control period is no whole
            multiple, with the nearest that are possible, a wrapper that counts decisions where
            there is another control period, or an argument of another kind.

    >>> import gymnasium as gym
    >>> import integ_gym
    >>> stock = gym.make("InvertedPendulum-v5")
    >>> env = integ_gym.rediscretize(stock, integrator="implicitfast", dt=0.01)
    >>> env.setup.timing.control_period, env.setup.timing.substeps
    (0.04, 4)
    """
    return RediscretizedEnv(
        env, solver, integrator=integrator, dt=dt, success_return=success_return,
        control_period=control_period, action_latency=action_latency,
        observation_latency=observation_latency, latency_jitter=latency_jitter,
        hold_probability=hold_probability,
    )  # fmt: skip


class RediscretizedEnv(foreign.ForeignWrapper):
    """A MuJoCo task whose discretization was chosen; made by :func:`rediscretize`.

    ``info`` has, beside the task's own, what every integ-gym environment tells: ``time``,
    ``energy``, ``actuator_work``, ``dissipated``, ``energy_residual``, solver report and success.
    ``energy_residual`` is left out of a control period in which a constraint acted, and it and
    ``dissipated`` wherever a loss is not accounted for. A motion that diverges ends the episode
    with the last finite observation; MuJoCo's own silent reset to the initial pose is switched off.

    Attributes:
        final_state: see :attr:`state_components`, before the last reset.
        final_status: see :attr:`status_code`, before the last reset.
    """

    def __init__(
        self, env: gym.Env[Any, Any], solver: Mapping[str, Any] | None = None, **chosen: Any
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, solver=solver, **chosen)
        super().__init__(env)
        check_versions("mujoco")
        self._mujoco = load("mujoco", "mujoco")
        self._inner = _mujoco_env(env)
        choice = Choice(**chosen)
        self._goal = self._make_goal(foreign.return_of_success(choice.success_return, env.spec))
        self._model, self._data = self._inner.model, self._inner.data
        write_solver(self._mujoco, self._model, solver or {})
        self._stretch = self._change_period(choice.control_period)
        self._stock = float(self._model.opt.timestep), int(self._inner.frame_skip)
        limited = self._model.actuator_ctrllimited.astype(bool)
        low, high = self._model.actuator_ctrlrange.T
        self._low, self._high = np.where(limited, low, -np.inf), np.where(limited, high, np.inf)
        self._command_low, self._command_high = self._command_bounds()
        self._ends = within_rounding(self._low, self._high)
        self._command_ends = within_rounding(self._command_low, self._command_high)
        self.setup = self._discretize_model(choice)
        self._silence = silencer(self._mujoco, self._data)
        self._ledger = Ledger(self._mujoco, self._model, self.setup.settings.integrator)
        self._inner.do_simulation = self._simulate
        timing = self.setup.timing
        self._none = np.zeros(len(self._command_low))
        self._queue = CommandQueue(timing, self._idle_command())
        self._seen_late = any(timing.sight)
        self._split = bool(timing.latency or timing.drawn or self._seen_late)
        if self._split:
            self._delay()
        self._booked = NOTHING
        self._saturated = False
        self._diverged = False

    def __getstate__(self) -> Any:
        """Refused: MuJoCo's data belong to the task that is wrapped.

        Raises:
            TypeError: always.
        """
        raise InputTypeError(
            "a rediscretized task cannot be pickled or copied; make another one and set its state"
        )

    @property
    def state(self) -> npt.NDArray[np.float64]:
        """Positions and velocities of the joints, SI units, shape (nq + nv,)."""
        return np.array(self.state_components)

    @property
    def state_components(self) -> tuple[float, ...]:
        """The same as floats."""
        q, v = self._data.qpos.tolist(), self._data.qvel.tolist()
        return join_state(tuple(q), tuple(v))

    @property
    def status_code(self) -> int:
        """The solver's status in the last control step, as a code of `STATUS_NAMES`."""
        if self._diverged:
            return DIVERGED
        if not self.setup.engine.reports:
            return NOT_REPORTED
        capped = self._booked.iterations >= self.setup.engine.solver_cap
        return NOT_CONVERGED if capped else OK

    @property
    def applied(self) -> tuple[str, float, int]:
        """Integrator, timestep (s) and timesteps per decision, read from the compiled model."""
        return (
            integrator_of(self._model),
            float(self._model.opt.timestep),
            int(self._inner.frame_skip),
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode."""
        self.final_state, self.final_status = self.state_components, self.status_code
        observation, info = self.env.reset(seed=seed, options=options)
        self._steps, self._least, self._earned = 0, 0.0, 0.0
        self._goal.begin()
        self._energy = self._ledger.energy(self._data)
        self._control = self._held = self._before = self._none
        self._queue.begin(seed)
        self._acting = [(self._none, self.setup.timing.substeps)]
        if self._seen_late:
            self._samples = [self._inner._get_obs()] * self.setup.timing.sight[0]
        self._observation, self._booked, self._diverged = observation, NOTHING, False
        return observation, {**info, **self._info(0.0, False, False, False)}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Advance one control period."""
        asked = as_floats(action)
        valid = bool(np.isfinite(asked).all())
        command = asked if valid else self._control
        self._set_steps(*self._stock)  # a task reads its own: `HumanoidStandup` divides by it
        try:
            observation, reward, terminated, truncated, info = self.env.step(
                command.astype(self._inner.action_space.dtype)
            )
        finally:
            self._set_steps(self.setup.timing.dt, self.setup.timing.substeps)
        self._steps += 1
        if self._stretch != 1.0:
            reward = self._stretch * float(reward)
        before = self._energy
        if self._diverged:
            observation, terminated = self._observation, True
            left = self.setup.timing.horizon - self._steps + 1
            reward = self._least * left - max(0.0, self._earned)
        self._observation = observation
        self._control = np.minimum(np.maximum(command, self._command_low), self._command_high)
        self._least = min(self._least, float(reward))
        self._earned += float(reward)
        self._energy = before if self._diverged else self._compute_energy()
        booked = self._booked
        residual = self._energy - before - booked.work + booked.dissipated
        residual = math.nan if booked.constrained else residual
        success = self._goal.note(float(reward), bool(terminated), bool(truncated), self._time)
        success = success and not self._diverged
        known = self._info(residual, valid and self._saturated, not valid, success)
        return observation, reward, bool(terminated), bool(truncated), {**info, **known}

    def _make_goal(self, success_return: float | None) -> foreign.ReturnGoal:
        """What a success is."""
        return foreign.ReturnGoal(success_return)

    def _idle_command(self) -> Any:
        """What acts until the first command arrives."""
        return self._none

    def _describe_model(self) -> Mapping[str, Any]:
        """What evidence records of the model; nothing of Gymnasium's, which its id defines."""
        return {}

    def _describe_plant(self) -> foreign.ForeignPlant:
        """Names and units of state and commands."""
        return plant_of(self._mujoco, self._model, type(self._inner).__name__)

    def _command_bounds(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Bounds of an action: the actuators', or those that a wrapper has put in their place.

        Raises:
            TypeError: for actions other than one number for each actuator.
        """
        space = self.action_space
        if not isinstance(space, gym.spaces.Box) or space.shape != (self._model.nu,):
            raise InputTypeError(
                f"rediscretize takes tasks whose actions are one number for each of the model's "
                f"{self._model.nu} actuators, got {space}; apply the wrapper that changes them to "
                "what rediscretize returns"
            )
        if space == self._inner.action_space:
            return self._low, self._high
        return space.low.astype(np.float64), space.high.astype(np.float64)

    def close(self) -> None:
        """Close the task, which then holds this no more, so that its model is freed at once."""
        super().close()
        for name in ("do_simulation", "step"):
            self._inner.__dict__.pop(name, None)

    def render(self) -> Any:
        """As the task draws itself.

        Raises:
            RuntimeError: where no OpenGL context can be had, with what to set.
        """
        try:
            return self.env.render()
        except Exception as error:
            words = f"{type(error).__module__} {type(error).__name__} {error}".lower()
            parts = ("opengl", "egl", "osmesa", "glfw", "x11", "display")
            if not any(part in words for part in parts):
                raise
            raise SetupError(no_context(os.environ.get("MUJOCO_GL"))) from error

    def _set_steps(self, timestep: float, frame_skip: int) -> None:
        """Put a timestep, s, and the number of them in a control period."""
        self._model.opt.timestep, self._inner.frame_skip = timestep, frame_skip

    def _compute_energy(self) -> float:
        """Energy of the state at the end of a control period, J."""
        return self._ledger.energy(self._data)

    def _simulate(self, control: Any, count: int) -> None:
        """What the task calls to advance its model; stands in for Gymnasium's ``do_simulation``.

        Args:
            control: one number for each actuator.
            count: the task's own ``frame_skip``: one control period.
        """
        timing = self.setup.timing
        if count != self._stock[1]:
            raise InputError(
                f"a task must be advanced by one control period at once, {self._stock[1]} of its "
                f"own timesteps, got {count}"
            )
        control = np.asarray(control, dtype=np.float64)
        if control.shape != (self._model.nu,):
            raise InputError(f"an action must have shape ({self._model.nu},), got {control.shape}")
        data, model = self._data, self._model
        q, v = data.qpos.copy(), data.qvel.copy()
        self._take_command(control)
        self._silence()
        self._set_steps(timing.dt, timing.substeps)
        self._booked = self._advance(control)
        self._diverged = self._ledger.is_lost(data)
        if self._diverged:
            data.qpos[:], data.qvel[:] = q, v
            self._mujoco.mj_forward(model, data)
            self._booked = self._ledger.put_back(self._booked)
        self._finish_period()
        self._set_steps(*self._stock)

    def _take_command(self, control: Array) -> None:
        """Note what the task made of an action."""
        self._applied = np.clip(control, self._low, self._high)
        self._saturated = at_bounds(control, self._ends)

    def _finish_period(self) -> None:
        """Compute what a task may read at the end of a control period."""
        self._mujoco.mj_rnePostConstraint(self._model, self._data)

    def _advance(self, control: Array) -> Booked:
        """One control period under the commands that act in it.

        What is observed later is looked at on the way.

        Args:
            control: what the task made of the last of them.
        """
        timing, data, booked = self.setup.timing, self._data, NOTHING
        if not self._split:
            ((acting, steps),) = self._segments(control)
            data.ctrl[:] = acting
            return self._ledger.step(data, steps)
        seen, begin = timing.substeps - timing.sight[1], 0
        for acting, steps in self._segments(control):
            data.ctrl[:], end = acting, begin + steps
            for stop in sorted({min(max(seen, begin), end), end} - {begin}):
                booked = add_up(booked, self._ledger.step(data, stop - begin))
                begin = stop
                if self._ledger.is_lost(data):
                    return booked
                if stop == seen < timing.substeps:
                    self._mujoco.mj_forward(self._model, data)
                    self._sample = self._inner._get_obs()
        return booked

    def _segments(self, control: Array) -> list[tuple[Array, int]]:
        """The controls that act in a period, and for how many timesteps each, oldest first.

        Raises:
            ValueError: under a jitter, of a task that steps with other numbers than it is given:
                what it makes of a command that acts within a period alone is not known.
        """
        last = self._acting[-1][0]
        if self.setup.timing.jitter and not np.array_equal(control, last):
            raise InputError(
                f"{type(self._inner).__name__} changes its actions itself, so `latency_jitter` "
                "is not possible; give `action_latency` or `hold_probability`"
            )
        controls = {id(self._before): self._held, id(last): control}
        self._before, self._held = last, control
        return [(controls.get(id(one), one), steps) for one, steps in self._acting]

    def _delay(self) -> None:
        """Have the task itself take late commands and return late observations.

        So wrappers around it see both as a policy does.
        """
        if self._seen_late and not hasattr(self._inner, "_get_obs"):
            raise InputError(f"{type(self._inner).__name__} cannot be observed late")
        step, whole = self._inner.step, not self.setup.timing.sight[1]

        def step_late(action: Any) -> tuple[Any, ...]:
            observation, *rest = step(self._order(action))
            if self._seen_late:
                newest = observation if whole else self._sample
                *self._samples, observation = (newest, *self._samples)
            return (observation, *rest)

        self._inner.step = step_late

    def _order(self, action: Any) -> Any:
        """Send a command; the action that the task receives."""
        self._acting = self._queue.give(action)
        return self._acting[-1][0]

    def _info(
        self, residual: float, saturated: bool, fell_back: bool, success: bool
    ) -> dict[str, Any]:
        booked = self._booked
        losses = {"dissipated": booked.dissipated, "energy_residual": residual}
        applied = self._control if self._steps == 0 else self._applied
        return {
            **self._common_info(self._control, applied, saturated, fell_back, success),
            **self._queue.info,
            "energy": self._energy,
            "actuator_work": booked.work,
            "clip_loss": 0.0,
            "penetration": booked.penetration,
            "constraint_violation": booked.violation,
            "solver_iterations": booked.iterations,
            "solver_residual": 0.0,
            "solver_status": STATUS_NAMES[self.status_code],
            **{name: value for name, value in losses.items() if not math.isnan(value)},
        }

    def _change_period(self, period: float | None) -> float:
        """Have decisions another control period, s; its ratio to the task's own."""
        stretch = 1.0 if period is None else period / float(self._inner.dt)
        if period is None or math.isclose(stretch, 1.0):
            return 1.0
        foreign.check_wrappers(
            "another control period", foreign.wrappers_of(self.env), foreign.COUNTS_DECISIONS
        )
        own = float(self._model.opt.timestep)
        count = whole_multiple("control_period", period, "the task's timestep", own)
        self._inner.frame_skip = count
        foreign.keep_duration(self.env, stretch)
        return stretch

    def _discretize_model(self, choice: Choice) -> foreign.ForeignSetup:
        """Put the discretization into the model, and say what it is."""
        model, inner, mujoco = self._model, self._inner, self._mujoco
        period = float(inner.dt)
        step = float(model.opt.timestep) if choice.dt is None else float(choice.dt)
        check_divides("dt", step, "the control period", period)
        chosen, known = choice.integrator or integrator_of(model), integrator_numbers()
        if chosen not in known:
            raise InputError(unknown_name("integrator of MuJoCo", chosen, known))
        limit = foreign.time_limit(self)
        horizon = 1000 if limit is None else limit
        delays: dict[str, Any] = delays_in(vars(choice))
        settings = Settings(
            integrator=chosen, dt=step, control_period=period, engine="mujoco",
            duration=horizon * period, start="the task's own",
            solver=read_solver(mujoco, model), **delays,
        )  # fmt: skip
        timing = timing_of(settings)
        model.opt.timestep = step
        model.opt.integrator = known[chosen]
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, NO_RESET, 0))
        inner.frame_skip = timing.substeps
        names = foreign.observation_names(self)
        goal = choice.success_return
        environment = {
            **(self.spec.kwargs if self.spec else {}),
            **({} if goal is None else {"success_return": goal}),
            **{name: value for name, value in delays.items() if value},
            "solver": settings.solver,
        }
        return foreign.ForeignSetup(
            settings=settings,
            timing=timing,
            plant=self._describe_plant(),
            task=foreign.ForeignTask(self._goal.words, names, ("",) * len(names)),
            engine=foreign.StatedEngine(
                "mujoco", 64, True, accounted=Ledger(mujoco, model, chosen).accounted,
                solver_tolerance=float(model.opt.tolerance), solver_cap=int(model.opt.iterations),
                stretch=self._stretch, model=self._describe_model(),
            ),
            action_space=self.action_space,
            environment=tuple(sorted(environment.items())),
            fingerprinted="cart_pole",
        )  # fmt: skip


def is_mujoco_task(env: gym.Env[Any, Any]) -> bool:
    """Whether one of Gymnasium's MuJoCo environments is inside; nothing is imported for that."""
    return any(kind.__name__ == "MujocoEnv" for kind in type(env.unwrapped).__mro__)


def _mujoco_env(env: gym.Env[Any, Any]) -> Any:
    """Gymnasium's MuJoCo environment inside.

    Raises:
        TypeError: if there is none, or it is rediscretized already.
    """
    load("mujoco", "mujoco")
    from gymnasium.envs.mujoco import MujocoEnv

    if not isinstance(env.unwrapped, MujocoEnv):
        raise InputTypeError(
            f"rediscretize takes one of Gymnasium's MuJoCo environments, got "
            f"{type(env.unwrapped).__name__}; for our own, give `integrator` and `dt` to gym.make"
        )
    if any(isinstance(one, RediscretizedEnv) for one in foreign.wrappers_of(env)):
        raise InputTypeError("the environment is rediscretized already; make a new one")
    return env.unwrapped
