"""``rediscretize``: a Gymnasium MuJoCo task with integrator and timestep of one's choice."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from integ_gym.support.packages.extras import load
from integ_gym.support.packages.versions import check_versions

from ...engines.mujoco import silencer
from ...episode.control_period import (
    DIVERGED,
    NOT_CONVERGED,
    OK,
    STATUS_NAMES,
)
from ...episode.settings import Settings
from ...episode.timing import Timing
from ...plants.interface import join_state
from ..bounds import at_bounds
from ..foreign import ForeignSetup, ForeignTask, ReturnGoal, return_of_success, time_limit
from ..lanes import as_floats
from .description import Choice, ModelEngine, integrator_numbers, plant_of
from .headless import is_of_opengl, no_context
from .ledger import NOTHING, Ledger, is_lost


def rediscretize(
    env: gym.Env[Any, Any],
    integrator: str | None = None,
    dt: float | None = None,
    success_return: float | None = None,
) -> RediscretizedEnv:
    """Change integrator and timestep of a Gymnasium MuJoCo environment.

    The control period stays, so that decisions and the time limit mean the same. The task pays one
    reward for each control period, by its own formula and with the timestep it was made with.

    Args:
        env: one that ``gym.make`` made of Gymnasium's MuJoCo environments; it is changed.
        integrator: MuJoCo's name: ``Euler``, ``RK4``, ``implicit``, ``implicitfast``,
            ``discrete``; None: as it is.
        dt: timestep, s; None: as it is.
        success_return: an episode succeeds if its return reaches this; None: if it is not
            terminated, or, of a task whose `reward_threshold` is negative, if it reaches that.

    Raises:
        TypeError: for another environment.
        ValueError: for an unknown integrator, a timestep of which the control period is no whole
            multiple, with the nearest that are possible, or an argument of another kind.

    >>> import gymnasium as gym
    >>> import integ_gym
    >>> stock = gym.make("InvertedPendulum-v5")
    >>> env = integ_gym.rediscretize(stock, integrator="implicitfast", dt=0.01)
    >>> env.setup.timing.control_period, env.setup.timing.substeps
    (0.04, 4)
    """
    return RediscretizedEnv(env, integrator, dt, success_return)


class RediscretizedEnv(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """A MuJoCo task whose discretization was chosen; made by :func:`rediscretize`.

    ``info`` has, beside the task's own, what every integ-gym environment tells: ``time``,
    ``energy``, ``actuator_work``, ``dissipated``, ``energy_residual``, solver report and success.
    ``energy_residual`` is left out of a control period in which a constraint acted, and it and
    ``dissipated`` wherever a loss is not accounted for. A motion that diverges ends the episode
    with the last finite observation; MuJoCo's own silent reset to the initial pose is switched off.

    Attributes:
        setup: timing, names and units, for evidence.
        final_state: see :attr:`state_components`, before the last reset.
        final_status: see :attr:`status_code`, before the last reset.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        integrator: str | None = None,
        dt: float | None = None,
        success_return: float | None = None,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(
            self, integrator=integrator, dt=dt, success_return=success_return
        )
        super().__init__(env)
        check_versions("mujoco")
        self._mujoco = load("mujoco", "mujoco")
        self._inner = _mujoco_env(env)
        choice = Choice(integrator, dt, success_return)
        self._goal = ReturnGoal(return_of_success(success_return, env.spec))
        self._model, self._data = self._inner.model, self._inner.data
        self._stock = float(self._model.opt.timestep), int(self._inner.frame_skip)
        limited = self._model.actuator_ctrllimited.astype(bool)
        low, high = self._model.actuator_ctrlrange.T
        self._low, self._high = np.where(limited, low, -np.inf), np.where(limited, high, np.inf)
        self._command_low, self._command_high = self._command_bounds()
        self.setup = self._discretized(choice)
        self._silence = silencer(self._mujoco, self._data)
        self._ledger = Ledger(self._mujoco, self._model, self.setup.settings.integrator)
        self._inner.do_simulation = self._simulate
        self._booked = NOTHING
        self._saturated = False
        self._diverged = False

    def __getstate__(self) -> Any:
        """Refused: MuJoCo's data belong to the task that is wrapped.

        Raises:
            TypeError: always.
        """
        raise TypeError(
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
    def fresh(self) -> bool:
        """Whether no step has been taken since the last reset."""
        return self._steps == 0

    @property
    def status_code(self) -> int:
        """The solver's status in the last control step, as a code of `STATUS_NAMES`."""
        if self._diverged:
            return DIVERGED
        capped = self._booked.iterations >= self.setup.engine.cap
        return NOT_CONVERGED if capped else OK

    @property
    def applied(self) -> tuple[str, float, int]:
        """Integrator, timestep (s) and timesteps per decision, read from the compiled model."""
        integrator = Choice().integrator_of(self._model)
        return integrator, float(self._model.opt.timestep), int(self._inner.frame_skip)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode."""
        self.final_state, self.final_status = self.state_components, self.status_code
        observation, info = self.env.reset(seed=seed, options=options)
        self._steps, self._least, self._earned = 0, 0.0, 0.0
        self._goal.begin()
        self._energy = self._ledger.energy(self._data)
        self._control = np.zeros(self._model.nu)
        self._observation, self._booked, self._diverged = observation, NOTHING, False
        return observation, {**info, **self._info(0.0, False, False, False)}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Advance one control period."""
        asked = as_floats(action)
        valid = bool(np.isfinite(asked).all())
        command = asked if valid else self._control
        with self._timed(*self._stock):
            observation, reward, terminated, truncated, info = self.env.step(
                command.astype(self._inner.action_space.dtype)
            )
        self._steps += 1
        before = self._energy
        if self._diverged:
            observation, terminated = self._observation, True
            left = self.setup.timing.horizon - self._steps + 1
            reward = self._least * left - max(0.0, self._earned)
        self._observation = observation
        self._control = np.clip(command, self._command_low, self._command_high)
        self._least = min(self._least, float(reward))
        self._earned += float(reward)
        self._energy = before if self._diverged else self._ledger.energy(self._data)
        booked = self._booked
        residual = self._energy - before - booked.work + booked.dissipated
        residual = math.nan if booked.constrained else residual
        time = self._steps * self.setup.timing.control_period
        success = self._goal.note(float(reward), bool(terminated), bool(truncated), time)
        success = success and not self._diverged
        told = self._info(residual, valid and self._saturated, not valid, success)
        return observation, reward, bool(terminated), bool(truncated), {**info, **told}

    def _command_bounds(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Bounds of an action: the actuators', or those that a wrapper has put in their place.

        Raises:
            TypeError: for actions other than one number for each actuator.
        """
        space = self.action_space
        if not isinstance(space, gym.spaces.Box) or space.shape != (self._model.nu,):
            raise TypeError(
                f"rediscretize takes tasks whose actions are one number for each of the model's "
                f"{self._model.nu} actuators, got {space}; apply the wrapper that changes them to "
                "what rediscretize returns"
            )
        if space == self._inner.action_space:
            return self._low, self._high
        return space.low.astype(np.float64), space.high.astype(np.float64)

    def render(self) -> Any:
        """As the task draws itself.

        Raises:
            RuntimeError: where no OpenGL context can be had, with what to set.
        """
        try:
            return self.env.render()
        except Exception as error:
            if not is_of_opengl(error):
                raise
            raise RuntimeError(no_context(os.environ.get("MUJOCO_GL"))) from error

    @contextmanager
    def _timed(self, timestep: float, frame_skip: int) -> Iterator[None]:
        """Another timestep, s, and number of them in a control period, for as long as it lasts.

        A task reads its own: `HumanoidStandup` divides its reward by the timestep.
        """
        option, inner = self._model.opt, self._inner
        kept = option.timestep, inner.frame_skip
        option.timestep, inner.frame_skip = timestep, frame_skip
        try:
            yield
        finally:
            option.timestep, inner.frame_skip = kept

    def _simulate(self, control: Any, count: int) -> None:
        """What the task calls to advance its model; stands in for Gymnasium's ``do_simulation``.

        Args:
            control: one number for each actuator.
            count: the task's own ``frame_skip``: one control period.
        """
        timing = self.setup.timing
        if count != self._stock[1]:
            raise ValueError(
                f"a task must be advanced by one control period at once, {self._stock[1]} of its "
                f"own timesteps, got {count}"
            )
        control = np.asarray(control, dtype=np.float64)
        if control.shape != (self._model.nu,):
            raise ValueError(f"an action must have shape ({self._model.nu},), got {control.shape}")
        data, model = self._data, self._model
        q, v = data.qpos.copy(), data.qvel.copy()
        data.ctrl[:] = control
        self._applied = np.clip(control, self._low, self._high)
        self._saturated = at_bounds(control, self._low, self._high)
        self._silence()
        with self._timed(timing.dt, timing.substeps):
            self._booked = self._ledger.step(data, timing.substeps)
            self._diverged = is_lost(data)
            if self._diverged:
                data.qpos[:], data.qvel[:] = q, v
                self._mujoco.mj_forward(model, data)
                self._booked = self._ledger.put_back(self._booked)
            self._mujoco.mj_rnePostConstraint(model, data)

    def _info(
        self, residual: float, saturated: bool, fell_back: bool, success: bool
    ) -> dict[str, Any]:
        time = self._steps * self.setup.timing.control_period
        booked = self._booked
        known = {"dissipated": booked.dissipated, "energy_residual": residual}
        applied = self._control if self._steps == 0 else self._applied
        controls = {}
        for (name, _), asked, given in zip(
            self.setup.plant.controls, self._control.tolist(), applied.tolist(), strict=True
        ):
            controls[f"{name}_commanded"], controls[f"{name}_applied"] = asked, given
        return {
            "time": time,
            "energy": self._energy,
            "actuator_work": booked.work,
            "clip_loss": 0.0,
            "saturated": saturated,
            "fallback_used": fell_back,
            "sensor_time": time,
            "goal_since": self._goal.since,
            "success": success,
            "penetration": booked.penetration,
            "constraint_violation": booked.violation,
            "solver_iterations": booked.iterations,
            "solver_residual": 0.0,
            "solver_status": STATUS_NAMES[self.status_code],
            **controls,
            **{name: value for name, value in known.items() if not math.isnan(value)},
        }

    def _discretized(self, choice: Choice) -> ForeignSetup:
        """Put the discretization into the model, and say what it is."""
        model, inner, mujoco = self._model, self._inner, self._mujoco
        period = float(inner.dt)
        step, chosen = choice.step_of(model, period), choice.integrator_of(model)
        limit = time_limit(self)
        horizon = 1000 if limit is None else limit
        timing = Timing.of(step, period, 0.0, None, horizon * period)
        model.opt.timestep = step
        model.opt.integrator = integrator_numbers()[chosen]
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        inner.frame_skip = timing.substeps
        size = int(np.prod(self.observation_space.shape or (1,)))
        names = tuple(f"obs{index}" for index in range(size))
        return ForeignSetup(
            settings=Settings(
                integrator=chosen, dt=step, control_period=period, engine="mujoco",
                duration=horizon * period, start="the task's own",
            ),
            timing=timing,
            plant=plant_of(mujoco, model, type(inner).__name__),
            task=ForeignTask(self._goal.words, names, ("",) * size),
            engine=ModelEngine(
                chosen, float(model.opt.tolerance), int(model.opt.iterations),
                Ledger(mujoco, model, chosen).accounted,
            ),
            action_space=self.action_space,
            environment=tuple(sorted((self.spec.kwargs if self.spec else {}).items())),
            fingerprinted="cart_pole",
        )  # fmt: skip


def _mujoco_env(env: gym.Env[Any, Any]) -> Any:
    """Gymnasium's MuJoCo environment inside.

    Raises:
        TypeError: if there is none, or it is rediscretized already.
    """
    load("mujoco", "mujoco")
    from gymnasium.envs.mujoco import MujocoEnv

    if not isinstance(env.unwrapped, MujocoEnv):
        raise TypeError(
            f"rediscretize takes one of Gymnasium's MuJoCo environments, got "
            f"{type(env.unwrapped).__name__}; for our own, give `integrator` and `dt` to gym.make"
        )
    wrapper: Any = env
    while wrapper is not env.unwrapped:
        if isinstance(wrapper, RediscretizedEnv):
            raise TypeError("the environment is rediscretized already; make a new one")
        wrapper = wrapper.env
    return env.unwrapped
