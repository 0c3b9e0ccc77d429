"""An environment with what integ-gym's own tell, as far as it is known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from ...episode.control_period import NOT_REPORTED
from ...episode.discretization import Discretization
from ..bounds import at_bounds
from ..foreign import ReturnGoal, return_of_success
from ..lanes import as_floats
from .setup import stated_setup

Array = npt.NDArray[np.float64]


class StatedEnv(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """An environment whose discretization is stated, with success and time in ``info``.

    Energy, work and losses are left out: they are not known. Actions are brought into the action
    space; in place of one that is not finite the last one holds, at first the one nearest to 0.

    Args:
        env: with a time limit; one step is one decision.
        applied: its discretization, read back from it.
        success_return: an episode succeeds if its return reaches this; None: if it is not
            terminated, or, where the task ends at its goal, by its `reward_threshold`.
        arguments: that it was made with, for evidence.

    Attributes:
        setup: timing, names and units, for evidence.
        state_components: nothing: the state is not known.
    """

    state_components: tuple[float, ...] = ()
    final_state: tuple[float, ...] = ()
    status_code = final_status = NOT_REPORTED

    def __init__(
        self,
        env: gym.Env[Any, Any],
        applied: Discretization,
        success_return: float | None = None,
        arguments: Mapping[str, Any] | None = None,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(
            self, applied=applied, success_return=success_return, arguments=arguments
        )
        super().__init__(env)
        self._goal = ReturnGoal(return_of_success(success_return, env.spec))
        self.setup = stated_setup(env, applied, self._goal.words, arguments or {})
        self._names = [name for name, _ in self.setup.plant.controls]
        self._steps = 0
        self._control = self._within(np.zeros(len(self._names)))

    @property
    def fresh(self) -> bool:
        """Whether no step has been taken since the last reset."""
        return self._steps == 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._steps = 0
        self._goal.begin()
        self._control = self._within(np.zeros(len(self._names)))
        return observation, {**info, **self._info(False, False, False)}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Advance one decision."""
        asked = as_floats(action).ravel()
        valid = bool(np.isfinite(asked).all())
        saturated = valid and self._saturates(asked)
        self._control = self._within(asked if valid else self._control)
        observation, reward, terminated, truncated, info = self.env.step(self._typed(self._control))
        self._steps += 1
        success = self._goal.note(float(reward), bool(terminated), bool(truncated), self._time)
        told = self._info(saturated, not valid, success)
        return observation, reward, bool(terminated), bool(truncated), {**info, **told}

    @property
    def _time(self) -> float:
        return self._steps * self.setup.timing.control_period

    def _within(self, control: Array) -> Array:
        """The nearest action of the space, as numbers."""
        space: Any = self.action_space
        if isinstance(space, gym.spaces.Discrete):
            return np.clip(np.rint(control), space.start, space.start + space.n - 1)
        return np.clip(control, space.low.ravel(), space.high.ravel())

    def _saturates(self, asked: Array) -> bool:
        """Whether a finite action is beyond the set, or at a bound of the box."""
        space: Any = self.action_space
        if isinstance(space, gym.spaces.Discrete):
            return bool((self._within(asked) != asked).any())
        return at_bounds(asked, space.low.ravel(), space.high.ravel())

    def _typed(self, control: Array) -> Any:
        """Numbers as an action of the space."""
        space: Any = self.action_space
        if isinstance(space, gym.spaces.Discrete):
            return int(control[0])
        return control.reshape(space.shape).astype(space.dtype)

    def _info(self, saturated: bool, fell_back: bool, success: bool) -> dict[str, Any]:
        controls = {}
        for name, given in zip(self._names, self._control.tolist(), strict=True):
            controls[f"{name}_commanded"] = controls[f"{name}_applied"] = given
        return {
            "time": self._time,
            "saturated": saturated,
            "fallback_used": fell_back,
            "sensor_time": self._time,
            "goal_since": self._goal.since,
            "success": success,
            **controls,
        }
