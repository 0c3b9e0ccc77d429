"""The vector environment: many environments as one structure of arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, ClassVar, TypeVar

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from integ_gym.envs.array_ops import ARRAY
from integ_gym.envs.environment import (
    IntegEnv,
    action_space,
    checked_render_mode,
    draw_start,
    make_setup,
    observation_space,
)
from integ_gym.envs.info import quiet_status
from integ_gym.envs.ops import Component
from integ_gym.envs.parameters import unknown_name
from integ_gym.envs.plants.interface import Plant, join_state, split_state
from integ_gym.envs.settings import Setup
from integ_gym.envs.system import PlantSystem
from integ_gym.envs.tasks.interface import Task
from integ_gym.envs.transition import (
    STATUS_NAMES,
    EnvState,
    Outcome,
    initial_state,
    transition,
)

Array = npt.NDArray[Any]
Tree = TypeVar("Tree", bound=tuple[Any, ...])
DISCRETIZATION = ("engine", "integrator", "dt", "control_period")
"""What the members of a mixture may differ in."""

_STATUS = np.array(STATUS_NAMES, dtype=object)


class IntegVectorEnv(VectorEnv[Any, Any, Any]):
    """`num_envs` environments advanced together; equal to `SyncVectorEnv` of the single one.

    Args:
        num_envs: number of lanes.
        autoreset_mode: an `AutoresetMode` or its value.
        mixture: discretizations (dicts of ``integrator``, ``dt``, …), one of which each lane draws
            at every reset; all must have one control period. ``info["mixture_index"]`` tells which.
        render_mode: ``"rgb_array"`` or None; :meth:`render` gives one frame per lane.
        arguments: those of the single environment; a plant parameter may be an array of shape
            (num_envs,).

    Raises:
        TypeError, ValueError: for unknown or impossible arguments.
    """

    env_class: ClassVar[type[IntegEnv]]
    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 30,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        mixture: Sequence[Mapping[str, Any]] | None = None,
        render_mode: str | None = None,
        **arguments: Any,
    ) -> None:
        self.num_envs = num_envs
        self.autoreset_mode = _checked_autoreset_mode(autoreset_mode)
        self.mixed = mixture is not None
        self.setups = _make_setups(self.env_class, arguments, mixture)
        for setup in self.setups:
            _check_lanes(setup, num_envs)
        self.setup = self.setups[0]
        self.render_mode = checked_render_mode(render_mode, type(self).metadata["render_modes"])
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}
        self.single_action_space = action_space(self.setup)
        self.single_observation_space = observation_space(self.setup)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._rngs: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self._state: EnvState | None = None
        self._done = np.zeros(num_envs, dtype=bool)
        self._member = np.zeros(num_envs, dtype=np.int64)
        self._noise = np.zeros((num_envs, 2 * len(self.setup.plant.coordinates)))
        self._control = np.zeros(num_envs)
        self._final_state = np.zeros_like(self._noise)
        self._renderers: list[Any] = []

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The lanes' generators."""
        self._seed_if_needed()
        return tuple(self._rngs)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The lanes' seeds."""
        self._seed_if_needed()
        return tuple(self._seeds)

    @property
    def state(self) -> npt.NDArray[np.float64]:
        """True states in Gymnasium's order, SI units, shape (num_envs, n)."""
        current = self._current()
        return np.stack(join_state(current.q, current.v), axis=1)

    @property
    def final_state(self) -> npt.NDArray[np.float64]:
        """With ``SAME_STEP``, true states before the last step's resets, shape (num_envs, n)."""
        return self._final_state.copy()

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode in every lane, or in those of ``options["reset_mask"]``.

        Args:
            seed: an int (lane i gets seed + i), one per lane, or None.
            options: as for the single environment; ``state`` has shape (num_envs, n).

        Raises:
            ValueError: for a mask, seed list or state of the wrong shape.
        """
        options = dict(options or {})
        mask = self._reset_mask(options.pop("reset_mask", None))
        self._seed(seed, mask)
        info = self._reset_lanes(mask, options)
        return self._observe(mask), _masked(info, mask)

    def step(self, actions: Any) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Advance every lane by one control period.

        Raises:
            gymnasium.error.ResetNeeded: before the first reset, or, with autoreset disabled, while
                a lane that has ended is not reset.
            ValueError: for actions of the wrong shape or outside a `Discrete` space.
        """
        self._current()
        waiting = self._done.copy()
        if self.autoreset_mode is AutoresetMode.DISABLED and waiting.any():
            raise gym.error.ResetNeeded(
                "these lanes have ended; reset them with options={'reset_mask': mask}: "
                f"{np.flatnonzero(waiting).tolist()}"
            )
        outcome = self._advance(self._read_actions(actions, waiting))
        everyone = np.ones(self.num_envs, dtype=bool)
        reward = self._full(outcome.reward)
        terminated = self._full(outcome.terminated, bool)
        truncated = self._full(outcome.truncated, bool)
        info = self._step_info(outcome)
        sampled = self._full(outcome.sampled, bool) & ~waiting
        if waiting.any():
            _overlay(info, self._reset_lanes(waiting, {}), waiting)
            reward[waiting], terminated[waiting], truncated[waiting] = 0.0, False, False
        observation = self._observe(sampled | waiting)
        self._done = terminated | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._done.any():
            observation, info = self._reset_same_step(observation, info)
        return observation, reward, terminated, truncated, _masked(info, everyone)

    def render(self) -> tuple[npt.NDArray[np.uint8], ...] | None:
        """One frame per lane."""
        if self.render_mode is None:
            gym.logger.warn('render() needs render_mode="rgb_array" in gym.make_vec')
            return None
        if not self._renderers:
            from integ_gym.envs.rendering import Renderer

            fps = self.metadata["render_fps"]
            self._renderers = [Renderer(setup, "rgb_array", fps) for setup in self.setups]
        times = self._current().steps * self.setup.timing.control_period
        lanes = zip(self._member, self.state, self._control, times, strict=True)
        return tuple(self._renderers[m].draw(state, u, time) for m, state, u, time in lanes)

    def close_extras(self, **kwargs: Any) -> None:
        """Release the drawing surfaces."""
        for renderer in self._renderers:
            renderer.close()
        self._renderers = []

    def _current(self) -> EnvState:
        if self._state is None:
            raise gym.error.ResetNeeded("call reset() before step(), state or render()")
        return self._state

    def _full(self, value: Component, dtype: Any = np.float64) -> Array:
        """A fresh array of shape (num_envs,)."""
        array = np.empty(self.num_envs, dtype=dtype)
        array[:] = value
        return array

    def _seed_if_needed(self) -> None:
        if not self._rngs:
            self._seed(None, np.ones(self.num_envs, dtype=bool))

    def _seed(self, seed: int | Sequence[int | None] | None, mask: Array) -> None:
        seeds = _lane_seeds(seed, self.num_envs)
        if not self._rngs:
            made = [seeding.np_random(s) for s in seeds]
            self._rngs = [rng for rng, _ in made]
            self._seeds = [int(s) for _, s in made]
            return
        for lane in np.flatnonzero(mask).tolist():
            if seeds[lane] is not None:
                self._rngs[lane], self._seeds[lane] = seeding.np_random(seeds[lane])

    def _reset_mask(self, mask: Any) -> Array:
        if mask is None:
            return np.ones(self.num_envs, dtype=bool)
        if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (self.num_envs,):
            raise ValueError(
                "reset option `reset_mask` must be a boolean array of shape "
                f"({self.num_envs},), got {mask!r}"
            )
        if not mask.any():
            raise ValueError("reset option `reset_mask` must select at least one lane")
        return mask

    def _reset_lanes(self, mask: Array, options: Mapping[str, Any]) -> dict[str, Array]:
        """Draw starts for the lanes of ``mask`` and return their info."""
        lanes = np.flatnonzero(mask)
        starts = np.array([self._draw(lane, options) for lane in lanes.tolist()])
        q, v = split_state(tuple(starts.T))
        setup = self._for_lanes(self.setup, lanes)
        if "state" not in options:
            q = setup.system.confined(ARRAY, q)
        fresh = initial_state(ARRAY, setup, q, v)
        fresh = _map(lambda x: np.array(np.broadcast_to(x, lanes.shape)), fresh)
        if self._state is None:
            self._state = _map(lambda x: np.zeros(self.num_envs, x.dtype), fresh)
        self._state = _put(self._state, lanes, fresh)
        self._done[lanes] = False
        self._control[lanes] = 0.0
        return self._reset_info()

    def _draw(self, lane: int, options: Mapping[str, Any]) -> tuple[float, ...]:
        rng = self._rngs[lane]
        if self.mixed:
            self._member[lane] = rng.integers(len(self.setups))
        if "state" in options:
            states = np.asarray(options["state"], dtype=np.float64)
            if states.shape[:1] != (self.num_envs,):
                raise ValueError(
                    f"reset option `state` must have one row per lane ({self.num_envs}), "
                    f"got shape {states.shape}"
                )
            options = {**options, "state": states[lane]}
        return draw_start(self.setup, rng, options)

    def _read_actions(self, actions: Any, ignored: Array) -> Array:
        """Actions as floats; those of lanes that are being reset are not looked at."""
        values = np.array(actions, dtype=np.float64)
        if values.shape != self.action_space.shape:
            raise ValueError(
                f"actions must have shape {self.action_space.shape}, got {values.shape}"
            )
        if self.setup.task.discrete is None:
            return values[:, 0]
        values[ignored] = 0.0
        wrong = np.isfinite(values) & ~np.isin(values, np.arange(self.setup.task.discrete))
        if wrong.any():
            raise ValueError(
                f"actions must be 0 … {self.setup.task.discrete - 1}, got {values[wrong][0]:g} in "
                f"lane {np.flatnonzero(wrong)[0]}"
            )
        return values

    def _advance(self, actions: Array) -> Outcome:
        with np.errstate(all="ignore"):
            if not self.mixed:
                self._state, outcome = transition(ARRAY, self.setup, self._current(), actions)
                return outcome
            return self._advance_mixture(actions)

    def _advance_mixture(self, actions: Array) -> Outcome:
        """Advance the lanes of each discretization as one group."""
        state = self._current()
        merged: Any = None
        for index, setup in enumerate(self.setups):
            lanes = np.flatnonzero(self._member == index)
            if not lanes.size:
                continue
            after, outcome = transition(
                ARRAY,
                self._for_lanes(setup, lanes),
                _map(lambda x, lanes=lanes: x[lanes], state),
                actions[lanes],
            )
            outcome = _map(lambda x, n=lanes.size: np.array(np.broadcast_to(x, n)), outcome)
            if merged is None:
                merged = _map(lambda x: np.zeros(self.num_envs, x.dtype), outcome)
            state, merged = _put(state, lanes, after), _put(merged, lanes, outcome)
        self._state = state
        return merged  # type: ignore[no-any-return]

    def _for_lanes(self, setup: Setup, lanes: Array) -> Setup:
        """``setup`` with the parameters of some lanes."""
        varied = _array_parameters(setup.plant) | _array_parameters(setup.task)
        if not varied or lanes.size == self.num_envs:
            return setup
        plant, task = _of_lanes(setup.plant, lanes), _of_lanes(setup.task, lanes)
        system = PlantSystem(plant, setup.system.max_speed)
        settings = setup.settings
        engine = type(setup.engine)(system, settings.integrator, settings.dt)  # type: ignore[call-arg]
        return replace(setup, plant=plant, task=task, system=system, engine=engine)

    def _observe(self, sampled: Array) -> Array:
        """Observations of all lanes; noise is drawn anew where the sensor has just sampled."""
        state = self._current()
        q, v = state.sensed_q, state.sensed_v
        noise = self.setup.settings.observation_noise
        if noise:
            for lane in np.flatnonzero(sampled):
                self._noise[lane] = noise * self._rngs[lane].standard_normal(self._noise.shape[1])
            by_q, by_v = split_state(tuple(self._noise.T))
            q = tuple(a + b for a, b in zip(q, by_q, strict=True))
            v = tuple(a + b for a, b in zip(v, by_v, strict=True))
        observed = self.setup.task.observe(ARRAY, q, v)
        observation = np.stack(observed, axis=1, dtype=np.float32, casting="same_kind")
        if noise:
            space = self.single_observation_space
            observation = np.clip(observation, space.low, space.high)  # type: ignore[attr-defined]
        return observation

    def _reset_same_step(
        self, observation: Array, info: dict[str, Array]
    ) -> tuple[Array, dict[str, Any]]:
        done = self._done.copy()
        self._final_state = self.state
        final_obs = np.full(self.num_envs, None, dtype=object)
        for lane in np.flatnonzero(done):
            final_obs[lane] = observation[lane].copy()
        final_info = _masked({k: _kept(x, done) for k, x in info.items()}, done)
        _overlay(info, self._reset_lanes(done, {}), done)
        merged = {
            **info,
            "final_obs": final_obs,
            "_final_obs": done,
            "final_info": final_info,
            "_final_info": done.copy(),
        }
        return self._observe(done), merged

    def _reset_info(self) -> dict[str, Array]:
        state = self._current()
        zeros = {
            name: np.zeros(self.num_envs)
            for name in (
                "time", "actuator_work", "dissipated", "contact_loss", "clip_loss",
                "energy_residual", "control", "commanded", "sensor_time", "penetration",
                "contact_force", "solver_residual",
            )
        }  # fmt: skip
        flags = {
            name: np.zeros(self.num_envs, dtype=bool)
            for name in ("saturated", "fallback_used", "success")
        }
        return self._with_member(
            {
                **zeros,
                **flags,
                "energy": state.energy.copy(),
                "goal_since": state.goal_since.copy(),
                "solver_iterations": np.zeros(self.num_envs, dtype=np.int64),
                "solver_status": np.full(self.num_envs, quiet_status(self.setup), dtype=object),
            }
        )

    def _step_info(self, outcome: Outcome) -> dict[str, Array]:
        state = self._current()
        full = self._full
        self._control = full(outcome.control)
        return self._with_member(
            {
                "time": full(state.steps * self.setup.timing.control_period),
                "energy": full(state.energy),
                "actuator_work": full(outcome.work),
                "dissipated": full(outcome.dissipated),
                "contact_loss": full(outcome.contact_loss),
                "clip_loss": full(outcome.clip_loss),
                "energy_residual": full(outcome.residual_energy),
                "control": self._control.copy(),
                "commanded": full(outcome.commanded),
                "saturated": full(outcome.saturated, bool),
                "fallback_used": full(outcome.fallback_used, bool),
                "sensor_time": full(state.sensed_time),
                "penetration": full(outcome.penetration),
                "contact_force": full(outcome.contact_force),
                "goal_since": full(state.goal_since),
                "success": full(outcome.success, bool),
                "solver_iterations": full(outcome.iterations, np.int64),
                "solver_residual": full(outcome.solver_residual),
                "solver_status": _STATUS[full(outcome.status, np.int64)],
            }
        )

    def _with_member(self, info: dict[str, Array]) -> dict[str, Array]:
        return {**info, "mixture_index": self._member.copy()} if self.mixed else info


def _make_setups(
    env_class: type[IntegEnv],
    arguments: Mapping[str, Any],
    mixture: Sequence[Mapping[str, Any]] | None,
) -> list[Setup]:
    if mixture is None:
        return [make_setup(env_class, arguments)]
    if isinstance(mixture, str | Mapping) or not isinstance(mixture, Sequence):
        raise ValueError(f"`mixture` must be a list of discretizations, got {mixture!r}")
    if not mixture:
        raise ValueError("`mixture` must list at least one discretization, got none")
    for member in mixture:
        if not isinstance(member, Mapping):
            raise ValueError(
                f'every member of `mixture` must be like {{"integrator": "rk4", "dt": 0.01}}, got '
                f"{member!r}"
            )
    for name in sorted({name for member in mixture for name in member}):
        if name not in DISCRETIZATION:
            raise ValueError(unknown_name("key in `mixture`", name, DISCRETIZATION))
    setups = [make_setup(env_class, {**arguments, **member}) for member in mixture]
    periods = sorted({setup.timing.control_period for setup in setups})
    if len(periods) > 1:
        raise ValueError(
            f"all discretizations of a mixture must have one control period, got {periods} s; "
            "give `control_period`"
        )
    return setups


def _checked_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        choices = ", ".join(repr(m.value) for m in AutoresetMode)
        raise ValueError(f"`autoreset_mode` must be one of {choices}, got {mode!r}") from None


def _array_parameters(part: Plant | Task) -> dict[str, Array]:
    """Parameters of a plant or task that differ between lanes."""
    return {
        name: value
        for name, value in vars(part).items()
        if name in _names(part) and isinstance(value, np.ndarray)
    }


def _names(part: Any) -> set[str]:
    return {f.name for f in fields(part)}


def _of_lanes(part: Any, lanes: Array) -> Any:
    """A plant or task with the parameters of some lanes."""
    return replace(part, **{name: x[lanes] for name, x in _array_parameters(part).items()})


def _check_lanes(setup: Setup, num_envs: int) -> None:
    if num_envs < 1:
        raise ValueError(f"`num_envs` must be 1 or above, got {num_envs}")
    for name, value in (_array_parameters(setup.plant) | _array_parameters(setup.task)).items():
        if value.shape != (num_envs,):
            raise ValueError(
                f"`{name}` must be a number or one value per environment, shape ({num_envs},), "
                f"got shape {value.shape}"
            )


def _lane_seeds(seed: int | Sequence[int | None] | None, num_envs: int) -> Sequence[int | None]:
    if seed is None:
        return [None] * num_envs
    if isinstance(seed, (int, np.integer)):
        return [int(seed) + lane for lane in range(num_envs)]
    if len(seed) != num_envs:
        raise ValueError(f"`seed` must be an int or one per lane ({num_envs}), got {len(seed)}")
    return seed


def _map(function: Any, tree: Tree) -> Tree:
    """Apply ``function`` to every array in nested (named) tuples."""
    values = [_map(function, x) if isinstance(x, tuple) else function(x) for x in tree]
    return type(tree)(*values) if hasattr(tree, "_fields") else tuple(values)  # type: ignore[return-value]


def _put(tree: Tree, lanes: Array, values: Tree) -> Tree:
    """``tree`` with ``values`` in some lanes."""
    merged = []
    for old, new in zip(tree, values, strict=True):
        if isinstance(old, tuple):
            merged.append(_put(old, lanes, new))
        else:
            array = np.array(old)
            array[lanes] = new
            merged.append(array)
    return type(tree)(*merged) if hasattr(tree, "_fields") else tuple(merged)  # type: ignore[return-value]


def _overlay(info: dict[str, Array], other: dict[str, Array], mask: Array) -> None:
    for name, values in other.items():
        info[name][mask] = values[mask]


def _kept(values: Array, mask: Array) -> Array:
    """``values`` in the lanes of ``mask``; nothing elsewhere."""
    nothing = np.full(values.shape, None, dtype=object) if values.dtype == object else 0
    return np.where(mask, values, nothing).astype(values.dtype)


def _masked(info: dict[str, Any], mask: Array) -> dict[str, Any]:
    """``info`` with Gymnasium's `_key` masks; lanes outside ``mask`` hold nothing."""
    everyone = bool(mask.all())
    masked: dict[str, Any] = {}
    for name, values in info.items():
        if name.startswith("_") or f"_{name}" in info:
            masked[name] = values
            continue
        masked[name] = values if everyone else _kept(values, mask)
        masked[f"_{name}"] = mask.copy()
    return masked
