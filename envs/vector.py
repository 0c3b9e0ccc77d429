"""Trees of components with one entry per lane, and settings that may differ between lanes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from integ_gym.support.errors import InputError

from . import environment
from .lanes import (
    DiscretizedVectorEnv,
    Info,
    LaneInfo,
    as_floats,
    check_lanes,
    lane_parameters,
    lane_seeds,
    mask_outside,
    part_of,
    put,
    setup_of_lanes,
    take,
    zeros_like,
)
from .ops.ops import ARRAY, Array, Components, join_state, rows_of, split_state
from .settings import Setup
from .starts import (
    ARRIVAL,
    MEMBER,
    NOISE,
    LaneStarts,
    check_options,
    draw_start,
    numbers_per_start,
    parse_episodes,
    parse_members,
    stream_of_episode,
)
from .steps import LanesStep
from .tasks.interface import to_public_order
from .transition import (
    RESULTS,
    EnvState,
    blank_info,
    control_columns,
    initial_state,
    quiet_status,
    sensed_state,
)

_FLOATS = np.dtype(np.float64)


class IntegVectorEnv(DiscretizedVectorEnv):
    """`num_envs` environments advanced together; equal to `SyncVectorEnv` of the single one.

    Arrays of `info` that hold one value for all lanes, and its masks, are read-only.

    Args:
        num_envs: number of lanes.
        autoreset_mode: an `AutoresetMode` or its value.
        mixture: discretizations (dicts of ``integrator``, ``dt``, … and, optionally, ``weight``),
            one of which each lane draws at every reset, and with it how often it decides.
            ``info["mixture_index"]`` tells which.
        render_mode: ``"rgb_array"`` or None; :meth:`render` gives one frame per lane.
        max_episode_steps: decisions after which an episode is truncated, if sooner than by
            `duration`.
        compiled: whether Numba compiles the step into a few loops over lanes, which takes one to
            five seconds, of the truth of contacts half a minute, and gives the same numbers sooner:
            at the second step, or never; None: where Numba is there and steps have taken long.
        arguments: those of the single environment; a plant parameter may be an array of shape
            (num_envs,).

    Raises:
        TypeError, ValueError: for unknown or impossible arguments.
        ModuleNotFoundError: with ``compiled`` and without Numba.
    """

    env_class: ClassVar[type[environment.IntegEnv]]
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
        max_episode_steps: int | None = None,
        compiled: bool | None = None,
        **arguments: Any,
    ) -> None:
        if compiled is not None and not isinstance(compiled, (bool, np.bool_)):
            raise InputError(f"`compiled` must be True or False, or left out, got {compiled!r}")
        self.num_envs = num_envs
        self.autoreset_mode = _check_autoreset_mode(autoreset_mode)
        self.mixed = mixture is not None
        self.mixture = environment.make_setups(self.env_class, {**arguments, "mixture": mixture})
        if not self._of_a_spec(max_episode_steps):
            self.mixture = self.mixture.limited(max_episode_steps)
        self.setups = self.mixture.setups
        for setup in self.setups:
            check_lanes(setup, num_envs)
        self.setup = self.setups[0]
        self.render_mode = environment.check_render_mode(
            render_mode, type(self).metadata["render_modes"]
        )
        self.metadata = {
            **type(self).metadata,
            "render_fps": environment.frames_per_second(self.setup),
            "autoreset_mode": self.autoreset_mode,
        }
        self.single_action_space = self.setup.action_space
        self.single_observation_space = environment.observation_space(self.setup)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._action_shape = self.action_space.shape
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._lanes_differ = bool(lane_parameters(self.setup))
        self._quiet = np.array([quiet_status(setup) for setup in self.setups])
        self._drawn = self.setup.timing.drawn
        self._info = LaneInfo(num_envs, blank_info(self.setup))
        self._steps = [LanesStep(setup, compiled) for setup in self.setups]
        self._rngs: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self.episodes = np.full(num_envs, -1)
        """How many episodes each lane has begun since its last seed, before this one."""
        self._noise_streams = dict[int, np.random.Generator]()
        self._arrivals = dict[int, np.random.Generator]()
        self._starts: LaneStarts | None = None
        self._state: EnvState | None = None
        self._done = np.zeros(num_envs, dtype=bool)
        self._member = np.zeros(num_envs, dtype=np.int64)
        self._noise = np.zeros((num_envs, 2 * len(self.setup.plant.coordinates)))
        self._applied = [applied for _, applied in control_columns(self.setup.plant)]
        self._controls = np.zeros((num_envs, len(self._applied)))
        self.status_codes = self._quiet[self._member]
        self.final_state = np.zeros_like(self._noise)
        self._renderers: list[Any] = []
        self._spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """What ``gym.make_vec`` made it from, with the decisions of an episode; None without it."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = environment.with_horizon(spec, self.mixture)
        if self._spec is not None:  # as gym.make_vec writes a limit that a spec has
            limit = {"max_episode_steps": self._spec.max_episode_steps}
            self._spec.kwargs = {**self._spec.kwargs, **limit}

    def _of_a_spec(self, limit: int | None) -> bool:
        """Whether ``gym.make_vec`` has a limit from a spec that says its horizon alone."""
        makers = environment.running_makers()
        if not makers or "max_episode_steps" in makers[0].f_locals.get("kwargs", {}):
            return False

        return environment.is_own_horizon(
            limit, makers, lambda a: environment.make_setups(self.env_class, a).horizon
        )

    def __getstate__(self) -> dict[str, Any]:
        """Without drawing surfaces, which are made again."""
        return {**self.__dict__, "_renderers": []}

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The lanes' generators."""
        self._seed_if_needed()
        if self._starts is not None:
            self._starts.put_back()
        return tuple(self._rngs)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The lanes' seeds."""
        self._seed_if_needed()
        return tuple(self._seeds)

    @property
    def state(self) -> npt.NDArray[np.float64]:
        """True states, each in the order of the single environment's, shape (num_envs, n)."""
        return to_public_order(self.setup.task, super().state)

    @property
    def state_components(self) -> Components:
        """True states in state order, component by component, each of shape (num_envs,)."""
        current = self._current()
        return join_state(current.q, current.v)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode in every lane, or in those of ``options["reset_mask"]``.

        Args:
            seed: an int (lane i gets seed + i), one per lane, or None.
            options: as for the single environment; ``state`` has shape (num_envs, n). In a mixture
                ``mixture_index``, shape (num_envs,), gives the members instead of drawing them;
                ``episode`` has that shape too.

        Raises:
            ValueError: for a mask, seed list, member or state of the wrong shape or value.
        """
        options = dict(options or {})
        mask = self._reset_mask(options.pop("reset_mask", None))
        if self.mixed and "mixture_index" in options:
            given = options["mixture_index"]
            options["mixture_index"] = parse_members(given, (self.num_envs,), len(self.setups))
        if "episode" in options:
            options["episode"] = parse_episodes(options["episode"], (self.num_envs,))
        self._seed(seed, mask)
        info = self._info.nothing()
        self._begin(np.flatnonzero(mask), options, info)
        observation = self._table(self._observed())
        return self._with_noise(observation, mask), self._visible_info(info, mask.copy())

    def step(self, actions: Any) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Advance every lane by one control period.

        Raises:
            gymnasium.error.ResetNeeded: before the first reset, or, with autoreset disabled, while
                a lane that has ended is not reset.
            ValueError: for actions of the wrong shape or outside a `Discrete` space.
        """
        self._current()
        (waiting,) = self._done.nonzero()
        if waiting.size and self.autoreset_mode is AutoresetMode.DISABLED:
            raise gym.error.ResetNeeded(
                "these lanes have ended; reset them with options={'reset_mask': mask}: "
                f"{waiting.tolist()}"
            )
        observation, step_values, alike = self._advance(self._read_actions(actions, waiting))
        reward, terminated, truncated, sampled = (
            self._info.result(name, step_values, alike) for name in RESULTS
        )
        info = self._info.of_step(step_values, alike)
        if self.render_mode is not None:
            self._controls = np.stack([info[name] for name in self._applied], axis=1)
        if waiting.size:
            self._begin_again(waiting, info, observation)
            reward[waiting], terminated[waiting], truncated[waiting] = 0.0, False, False
            sampled[waiting] = True
        self.status_codes = info["solver_status"]
        observation = self._with_noise(observation, sampled)
        self._done = terminated | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._done.any():
            observation, everything = self._reset_same_step(observation, info)
        else:
            everything = self._visible_info(info, self._info.everyone)
        return observation, reward, terminated, truncated, everything

    def render(self) -> tuple[npt.NDArray[np.uint8], ...] | None:
        """One frame per lane."""
        if self.render_mode is None:
            gym.logger.warn('render() needs render_mode="rgb_array" in gym.make_vec')
            return None
        if not self._renderers:
            from .rendering.renderer import Renderer

            fps = self.metadata["render_fps"]
            self._renderers = [Renderer(setup, "rgb_array", fps) for setup in self.setups]
        times = self._current().steps * np.array(self.mixture.periods)[self._member]
        states = np.stack(self.state_components, axis=1)
        lanes = zip(self._member, states, self._controls, times, strict=True)
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

    def _seed_if_needed(self) -> None:
        if not self._rngs:
            self._seed(None, np.ones(self.num_envs, dtype=bool))

    def _seed(self, seed: int | Sequence[int | None] | None, mask: Array) -> None:
        seeds = lane_seeds(seed, self.num_envs)
        if not self._rngs:
            pairs = [seeding.np_random(s) for s in seeds]
            self._rngs, self._seeds = [rng for rng, _ in pairs], [int(s) for _, s in pairs]
            size = numbers_per_start(self.setup)  # starts are drawn ahead where they are uniform
            self._starts = None if size is None else LaneStarts(self.setup, self._rngs, size)
            return
        for lane in np.flatnonzero(mask).tolist():
            if seeds[lane] is not None:
                self.episodes[lane] = -1
                self._rngs[lane], self._seeds[lane] = seeding.np_random(seeds[lane])
                if self._starts is not None:
                    self._starts.forget(lane)

    def _reset_mask(self, mask: Any) -> Array:
        if mask is None:
            mask = np.ones(self.num_envs, dtype=bool)
        if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (self.num_envs,):
            raise InputError(
                "reset option `reset_mask` must be a boolean array of shape "
                f"({self.num_envs},), got {mask!r}"
            )
        if not mask.any():
            raise InputError("reset option `reset_mask` must select at least one lane")
        return mask

    def _begin(self, lanes: Array, options: Mapping[str, Any], info: Info) -> None:
        """Start an episode in some lanes, and tell about it."""
        self._count_episodes(lanes, options)
        starts = self._draw(lanes, options)
        q, v = split_state(tuple(starts.T))
        setup = self._for_lanes(self.setup, lanes)
        if "state" not in options:
            q = setup.system.confine(ARRAY, q)
        fresh = initial_state(ARRAY, setup, q, v)
        if self._state is None:
            self._state = zeros_like(fresh, self.num_envs)
        self._state = put(self._state, lanes, fresh, self.num_envs)
        self._done[lanes] = False
        self._controls[lanes] = 0.0
        self._info.begin(info, lanes, fresh.energy, fresh.goal_since)
        if self.mixed:
            info["solver_status"][lanes] = self._quiet[self._member[lanes]]

    def _begin_again(self, lanes: Array, info: Info, observation: Array) -> None:
        """The same after a step, whose arrays and observation, without noise, are written into."""
        if self._starts is None or self._lanes_differ or self.mixed:
            self._begin(lanes, {}, info)
            state, task = self._current(), self._for_lanes(self.setup, lanes).task
            q, v = take(state.sensed_q, lanes), take(state.sensed_v, lanes)
            for column, values in enumerate(task.observe(ARRAY, q, v)):
                observation[lanes, column] = values
            return
        self._count_episodes(lanes, {})
        step = self._steps[0]
        begun = self._starts.begin(lanes, step.first)
        self._state = step.begin(self._current(), lanes, begun)
        observation[lanes] = begun.observation
        self._done[lanes] = False
        self._controls[lanes] = 0.0
        self._info.begin(info, lanes, begun.energy, begun.goal_since)

    def _count_episodes(self, lanes: Array, options: Mapping[str, Any]) -> None:
        """Number the episodes that begin in some lanes, and draw what each has of its own."""
        self.episodes[lanes] += 1
        if "episode" in options:
            self.episodes[lanes] = options["episode"][lanes]
        noisy = self.setup.settings.observation_noise > 0.0
        if self.mixed and "mixture_index" in options:
            self._member[lanes] = options["mixture_index"][lanes]
        drawn = self.mixed and "mixture_index" not in options
        if not (noisy or drawn or self._drawn):
            return
        for lane, episode in zip(lanes.tolist(), self.episodes[lanes].tolist(), strict=True):
            rng = self._rngs[lane]
            if noisy:
                self._noise_streams[lane] = stream_of_episode(rng, NOISE, episode)
            if self._drawn:
                self._arrivals[lane] = stream_of_episode(rng, ARRIVAL, episode)
            if drawn:
                number = stream_of_episode(rng, MEMBER, episode).random()
                self._member[lane] = self.mixture.member(number)

    def _draw(self, lanes: Array, options: Mapping[str, Any]) -> Array:
        """Starts of some lanes, shape (len(lanes), n)."""
        check_options(self.setup, options, ("mixture_index",) if self.mixed else ())
        if self._starts is None or "state" in options:
            return np.array([self._draw_one(lane, options) for lane in lanes.tolist()])
        return self._starts.draw(lanes, options)

    def _draw_one(self, lane: int, options: Mapping[str, Any]) -> Components:
        options = {name: value for name, value in options.items() if name != "mixture_index"}
        if "state" in options:
            states: Any = options["state"]
            if not hasattr(states, "__len__") or len(states) != self.num_envs:
                raise InputError(
                    f"reset option `state` must have one row per lane ({self.num_envs}), "
                    f"got {states!r:.60}"
                )
            options["state"] = states[lane]
        setup = self.setup
        if self._lanes_differ:
            setup = replace(setup, task=part_of(setup.task, lane))
        return draw_start(setup, self._rngs[lane], options)

    def _read_actions(self, actions: Any, ignored: Array) -> Components:
        """Actions as floats, by entry; those of lanes that are being reset are not looked at."""
        values = as_floats(actions, self.setup.task.discrete is None)
        if values.shape != self._action_shape:
            raise InputError(f"actions must have shape {self._action_shape}, got {values.shape}")
        if ignored.size:
            values[ignored] = 0.0
        count = self.setup.task.discrete
        if count is None:
            return (values[:, 0],) if values.shape[1] == 1 else tuple(values.T)
        if getattr(actions, "dtype", _FLOATS).kind in "biu":
            known = actions.astype(np.uint64) < count  # what is negative becomes large
            known[ignored] = True
        else:
            known = (values >= 0.0) & (values < count) & (values == np.floor(values))
        if np.count_nonzero(known) < known.size:
            wrong = np.isfinite(values) & ~known
            if wrong.any():
                raise InputError(
                    f"actions must be 0 … {count - 1}, got {values[wrong][0]:g} in "
                    f"lane {np.flatnonzero(wrong)[0]}"
                )
        return (values,)

    def _advance(self, actions: Components) -> tuple[Array, dict[str, Any], Mapping[str, Any]]:
        """Observations, without noise, what a step tells, and what is alike; see `LanesStep`."""
        given: tuple[Any, ...] = (actions,)
        if self._drawn:
            drawn = np.array([self._arrivals[lane].random(2) for lane in range(self.num_envs)])
            given = (*drawn.T.copy(),), actions
        if self.mixed:
            return self._advance_mixture(given)
        step = self._steps[0]
        self._state, observation, step_values = step(self._current(), *given)
        return observation, step_values, step.alike

    def _advance_mixture(
        self, given: tuple[Any, ...]
    ) -> tuple[Array, dict[str, Any], Mapping[str, Any]]:
        """Advance the lanes of each discretization as one group."""
        state = self._current()
        merged: dict[str, Any] = {}
        observation = np.empty(self.observation_space.shape or (), dtype=np.float32)
        for index, setup in enumerate(self.setups):
            lanes = np.flatnonzero(self._member == index)
            if not lanes.size:
                continue
            own = self._for_lanes(setup, lanes)
            step = self._steps[index] if own is setup else LanesStep(own)
            after, observation[lanes], step_values = step(take(state, lanes), *take(given, lanes))
            state = put(state, lanes, after, self.num_envs)
            for name, value in {**step.alike, **step_values}.items():
                if name not in merged:
                    merged[name] = np.zeros(self.num_envs, dtype=np.asarray(value).dtype)
                merged[name][lanes] = value
        self._state = state
        return observation, merged, {}

    def _for_lanes(self, setup: Setup, lanes: Array) -> Setup:
        return setup_of_lanes(setup, lanes) if self._lanes_differ else setup

    def _observed(self, noise: Components = ()) -> Components:
        """Observations of all lanes."""
        return self.setup.task.observe(ARRAY, *sensed_state(self._current(), noise))

    def _table(self, observed: Components) -> Array:
        """Observations as float32, shape (num_envs, n)."""
        return rows_of(observed, self.num_envs, np.float32)

    def _with_noise(self, observation: Array, sampled: Array) -> Array:
        """Observations with noise, drawn anew where the sensor has just sampled."""
        noise = self.setup.settings.observation_noise
        if not noise:
            return observation
        space = self.single_observation_space
        for lane in np.flatnonzero(sampled).tolist():
            self._noise[lane] = noise * self._noise_streams[lane].standard_normal(
                self._noise.shape[1]
            )
        noisy = self._table(self._observed(tuple(self._noise.T)))
        return np.clip(noisy, space.low, space.high)  # type: ignore[attr-defined]

    def _reset_same_step(self, observation: Array, info: Info) -> tuple[Array, dict[str, Any]]:
        done = self._done.copy()
        lanes = np.flatnonzero(done)
        self.final_state = self.state
        final_obs = np.full(self.num_envs, None, dtype=object)
        for lane in lanes:
            final_obs[lane] = observation[lane].copy()
        final_info = self._info.with_masks(mask_outside(self._arrays(info), done), done)
        self.status_codes = self.status_codes.copy()
        self._begin_again(lanes, info, observation)
        everything = {
            **self._visible_info(info, self._info.everyone),
            "final_obs": final_obs,
            "_final_obs": done,
            "final_info": final_info,
            "_final_info": done.copy(),
        }
        return self._with_noise(observation, done), everything

    def _arrays(self, info: Info) -> Info:
        return {**info, "mixture_index": self._member.copy()} if self.mixed else info

    def _visible_info(self, info: Info, mask: Array) -> dict[str, Any]:
        arrays = self._arrays(info)
        if self.mixed and mask is not self._info.everyone:
            arrays["mixture_index"][~mask] = 0
        return self._info.with_masks(arrays, mask)


def _check_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        choices = ", ".join(repr(m.value) for m in AutoresetMode)
        raise InputError(f"`autoreset_mode` must be one of {choices}, got {mode!r}") from None
