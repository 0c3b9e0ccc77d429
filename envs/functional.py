"""The environments as pure functions of JAX arrays: for ``jit``, ``vmap`` and ``scan``."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import cached_property
from itertools import accumulate, pairwise, repeat
from typing import Any, NamedTuple

import numpy as np
from gymnasium.experimental.functional import FuncEnv

from integ_gym.support.errors import InputError

from .environment import environment_mixture, environment_setup, observation_space
from .ops.jax_ops import JaxOps, jax, jnp
from .ops.ops import Component, Components, join_state, split_state
from .settings import WEIGHT, Mixture, Setup
from .starts import ARRIVAL, GivenNumbers
from .tasks.interface import to_state_order
from .transition import EnvState, Outcome, initial_state, sensed_state, step_info, transition

OPTIONAL = ("stops", "dry_friction", "speed_limits")
"""Parts of a plant that it may lack, which decides the program."""

__all__ = ["FunctionalEnv", "Params", "make", "start_range"]


class Structure(NamedTuple):
    """What decides the program: environments with equal structure can share a compiled one."""

    env_id: str
    dtype: str
    """Float type of the physics."""
    choices: tuple[tuple[str, Any], ...]
    """Arguments that are no numbers, and the presence of those that may be None."""
    delays: tuple[Any, ...]
    """Action and observation latency, each as (whole decisions, sub-steps beyond them); and where
    arrivals are drawn, jitter in sub-steps, probability of a hold, and commands remembered."""


def structure_of(env_id: str, setup: Setup, dtype: str) -> Structure:
    """What a setup decides of the program, with floats in the type ``dtype``."""
    choices = {
        name: value
        for name, value in setup.arguments().items()
        if isinstance(value, (str, bool)) and name != "start"
    }
    present = {
        "sensor_period": setup.timing.sensor is not None,
        "max_speed": setup.settings.max_speed is not None,
        "observation_noise": setup.settings.observation_noise > 0.0,
        "solver": tuple((setup.settings.solver or {}).items()),
        **{part: getattr(setup.plant, part, None) is not None for part in OPTIONAL},
        "absent": tuple(
            f.name
            for part in (setup.plant, setup.task)
            for f in fields(part)  # type: ignore[arg-type]
            if getattr(part, f.name) is None
        ),
    }
    timing = setup.timing
    drawn = (timing.jitter, timing.hold, timing.memory) if timing.drawn else ()
    delays = (timing.delay, timing.sight, *drawn)
    return Structure(env_id, dtype, tuple({**choices, **present}.items()), delays)


class Params(NamedTuple):
    """What may differ between environments that share one program.

    Every entry is a number, or an array that broadcasts against the lanes. Where ``substeps`` is an
    array, lanes with fewer wait for those with more. Given to a compiled function as an argument,
    it can take any value; the loop over sub-steps then also keeps XLA from computing a motion anew
    for everything that depends on it.
    """

    dt: Component
    """Integration step, s."""
    control_period: Component
    """Time between two decisions, s."""
    substeps: Component
    """Integration steps per decision, int32."""
    horizon: Component
    """Decisions until truncation, int32."""
    sensor: Component | None
    """Integration steps between two samples, int32; None: one sample per decision."""
    max_speed: Component | None
    """Clip on every velocity, rad/s or m/s; None: no clip."""
    observation_noise: Component
    """Standard deviation of each sensed state component, SI."""
    start_low: Components
    """Lower end of the start distribution, in state order, SI."""
    start_high: Components
    plant: dict[str, Component]
    """Numeric plant parameters, SI."""
    task: dict[str, Component]


def params_of(setup: Setup, dtype: str) -> Params:
    """A setup's own values, floats in the type ``dtype``."""
    settings, timing = setup.settings, setup.timing
    number = np.dtype(dtype).type

    def numbers(part: Any) -> dict[str, Component]:
        """Numeric fields of a plant or task."""
        values = {f.name: getattr(part, f.name) for f in fields(part)}
        return {k: number(x) for k, x in values.items() if not isinstance(x, str | bool | None)}

    low, high = (tuple(map(number, end)) for end in start_range(setup))
    return Params(
        dt=number(timing.dt),
        control_period=number(timing.control_period),
        substeps=np.int32(timing.substeps),
        horizon=np.int32(timing.horizon),
        sensor=None if timing.sensor is None else np.int32(timing.sensor),
        max_speed=None if settings.max_speed is None else number(settings.max_speed),
        observation_noise=number(settings.observation_noise),
        start_low=low,
        start_high=high,
        plant=numbers(setup.plant),
        task=numbers(setup.task),
    )


def start_range(setup: Setup) -> tuple[Components, Components]:
    """Lowest and highest start, in state order, SI units.

    Starts are drawn uniformly in a box, so its corners are what the task makes of the ends of all
    its draws.
    """
    task, start = setup.task, setup.settings.start
    low, high = (task.draw_start(GivenNumbers(repeat(x)), start, {}) for x in (0.0, 1.0))
    return low, high


def setup_with_params(setup: Setup, params: Params) -> Setup:
    """``setup`` with these values."""
    plant = replace(setup.plant, **params.plant)  # type: ignore[type-var]
    task = replace(setup.task, **params.task)  # type: ignore[type-var]
    vars(plant).update({x: None for x in OPTIONAL if getattr(setup.plant, x, None) is None})
    for part in (plant, task):  # so that no cached property is first computed inside a loop
        for name in dir(type(part)):
            if isinstance(getattr(type(part), name, None), cached_property):
                getattr(part, name)
    names = ("dt", "control_period", "substeps", "sensor", "horizon")
    timing = replace(setup.timing, **{name: getattr(params, name) for name in names})
    return setup.with_values(plant, task, timing, params.max_speed)


DTYPES = ("float32", "float64")


class FuncState(NamedTuple):
    """State of one environment, or of a batch of them."""

    env: EnvState
    outcome: Outcome
    """What the last transition brought; zeros after a reset."""
    noise: Components
    """Noise of the last sample on each state component, SI; empty without sensor noise."""
    member: Components = ()
    """In a mixture: the member that each lane has drawn, int32; else empty."""


class TimeStep(NamedTuple):
    """What one step with automatic reset gives."""

    observation: Any
    """Of the next episode's start where an episode has ended, float32, shape (*lanes, obs)."""
    reward: Any
    terminated: Any
    truncated: Any
    final_observation: Any
    """Before the reset, float32, shape (*lanes, obs)."""
    info: dict[str, Any]
    """Before the reset; see :meth:`FunctionalEnv.transition_info`."""


def functional_setup(env_id: str, arguments: Mapping[str, Any]) -> Setup:
    """The setup, if JAX can advance it.

    Raises:
        TypeError, ValueError: see :func:`make`.
    """
    if arguments.get("contact") == "engine":
        raise InputError(
            "the functional environment has no `contact`='engine'; use 'compliant', the same law "
            "in every engine, or gym.make or gym.make_vec"
        )
    setup = environment_setup(env_id, arguments)
    if not setup.engine.batched:
        raise InputError(
            "the functional environment needs an engine made of JAX's operations, 'native' or "
            f"'mjx', got {setup.settings.engine!r}; use gym.make or gym.make_vec"
        )
    return setup


class FunctionalEnv(FuncEnv[FuncState, Any, Any, Any, Any, Any, Params]):
    """An environment as pure functions; see :func:`make`.

    All functions take a single environment or a batch: components of shape ``lanes``, actions of
    shape (*lanes, n) for a `Box` and ``lanes`` for a `Discrete` space. A `Discrete` action that is
    none of the choices cannot raise here and counts as 0; a non-finite one calls the fallback.

    Attributes:
        setup: plant, task, timing and engine with the constructor's values.
        setups: all that an episode may run on; more than one in a mixture.
        shares: of each of them.
        structure: what a compiled function depends on.
        start_size: numbers that a start is made of.
        arrival_size: numbers that are drawn for every command: 2 where arrivals are, else 0.
        default_params: the constructor's values.
    """

    def __init__(
        self,
        env_id: str,
        *,
        dtype: str = "float32",
        **arguments: Any,
    ) -> None:
        if dtype not in DTYPES:
            raise InputError(f"`dtype` must be one of {', '.join(DTYPES)}, got {dtype!r}")
        if dtype == "float64" and not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
            raise InputError(
                "float64 needs JAX's 64-bit mode; make and use the environment inside "
                "`with jax.enable_x64(True):`"
            )
        self.env_id = env_id
        self._arguments = arguments
        self._dtype = dtype
        self._ops = JaxOps(dtype)
        self.setup = functional_setup(env_id, arguments)
        self.setups: tuple[Setup, ...] = (self.setup,)
        self.shares: tuple[Fraction, ...] = (Fraction(1),)
        self.start_size = 2 * len(self.setup.plant.coordinates)
        self.arrival_size = 2 * self.setup.timing.drawn
        self.structure: Hashable = structure_of(env_id, self.setup, dtype)
        self.observation_space = observation_space(self.setup)
        self.action_space = self.setup.action_space
        super().__init__()

    def get_default_params(self, **kwargs: Any) -> Params:
        """The constructor's values, those in ``kwargs`` replaced; see :meth:`params`."""
        return self.params(**kwargs)

    def params(self, **arguments: Any) -> Params:
        """Values of other constructor arguments for the same program.

        Args:
            arguments: replace those that the environment was made with.

        Raises:
            TypeError: for an unknown argument.
            ValueError: for an impossible value, or one that needs another program.
        """
        setup = functional_setup(self.env_id, {**self._arguments, **arguments})
        self._check_structure(structure_of(self.env_id, setup, self._dtype))
        return params_of(setup, self._dtype)

    def columns(self, params: Sequence[Any]) -> Any:
        """Values of several environments, each with so many sub-steps, as columns.

        Returns:
            Entries of shape (environments, 1), which broadcast against (environments, lanes).
        """
        joined = jax.tree.map(lambda *values: np.array(values)[:, None], *params)
        return joined._replace(substeps=params[0].substeps)

    def check_lanes(self, count: int) -> None:
        """Check that so many lanes can be advanced together; a mixture may refuse."""

    def initial(
        self, rng: Any, params: Params | None = None, lanes: tuple[int, ...] = ()
    ) -> FuncState:
        """A start state.

        Args:
            rng: JAX key.
            params: defaults to the environment's own.
            lanes: shape of a batch of independent starts.
        """
        params = self._default(params)
        start_key, noise_key = jax.random.split(rng)
        drawn = jax.random.uniform(start_key, (self.start_size, *lanes), self._dtype)
        return self._first(*self.fresh(tuple(drawn), params), noise_key, params)

    def initial_from(
        self, state: Any, rng: Any, params: Params | None = None, member: Components = ()
    ) -> FuncState:
        """An episode that starts in a given state.

        Args:
            state: in the order of ``env.unwrapped.state``, SI units, shape (*lanes, n).
            rng: JAX key, for the sensor noise.
            params: defaults to the environment's own.
            member: in a mixture: (the member of each lane,), int32, shape ``lanes``.
        """
        ordered = to_state_order(self.setup.task, jnp.asarray(state, self._dtype))
        start = tuple(jnp.moveaxis(ordered, -1, 0))
        params = self._default(params)
        begun = self.begin(start, self.lane_params(params, member))
        return self._first(begun, member, rng, params)

    def lane_params(self, params: Params, member: Components) -> Any:
        """The values that hold in every lane, for what is asked of a state: ``params`` itself.

        In a mixture they depend on what each lane has drawn; see `FuncState.member`.
        """
        return params

    def fresh(self, drawn: Components, params: Any) -> tuple[EnvState, Components]:
        """Episodes that start anew, and in a mixture what they have drawn.

        Args:
            drawn: ``start_size`` numbers from [0, 1), components of one shape.
            params: values.
        """
        return self.begin(self.start(drawn, params), params), ()

    def common(self, params: Any) -> Params:
        """The values that hold in all lanes, of what :meth:`lane_params` gives."""
        return params  # type: ignore[no-any-return]

    def setup_of(self, params: Any) -> Setup:
        """Plant, task, timing and engine with these values."""
        return setup_with_params(self.setup, self.common(params))

    def start(self, drawn: Components, params: Any) -> Components:
        """A start in state order, SI units, made of numbers from [0, 1), one per component."""
        own = self.common(params)
        limits = zip(drawn, own.start_low, own.start_high, strict=True)
        q, v = split_state(tuple(low + x * (high - low) for x, low, high in limits))
        return join_state(self.setup_of(params).system.confine(self._ops, q), v)

    def begin(self, start: Components, params: Any) -> EnvState:
        """Episodes that start in ``start``, in state order, components of one shape."""
        q, v = split_state(start)
        fresh = initial_state(self._ops, self.setup_of(params), q, v)
        return self._cast(fresh, jnp.shape(q[0]))  # type: ignore[no-any-return]

    def advance(
        self, env: EnvState, action: Components, params: Params, drawn: Components = ()
    ) -> tuple[EnvState, Outcome]:
        """One control period, without the sensor's noise.

        Args:
            env: components of one shape.
            action: one entry per control, or an action's index, of that shape.
            params: values that broadcast against it.
            drawn: two numbers from [0, 1) of that shape where arrivals of commands are drawn, see
                :attr:`arrival_size`.
        """
        after = transition(self._ops, self.setup_of(params), env, action, drawn or None)
        return self._cast(after, jnp.shape(env.q[0]))  # type: ignore[no-any-return]

    def observe(self, env: EnvState, noise: Components, params: Any) -> Components:
        """The last sensor sample, one float32 component per observation.

        Args:
            env: episode state.
            noise: standard noise of the sample, one component per state component, or empty.
            params: scale of the noise.
        """
        own = self.common(params)
        q, v = sensed_state(env, tuple(own.observation_noise * x for x in noise))
        task = self.setup_of(params).task
        observed = tuple(x.astype(jnp.float32) for x in task.observe(self._ops, q, v))
        if not noise:
            return observed
        limits = zip(observed, task.observation_limits(own.max_speed), strict=True)
        return tuple(jnp.clip(x, -limit, limit).astype(jnp.float32) for x, limit in limits)

    def transition(
        self, state: FuncState, action: Any, rng: Any, params: Params | None = None
    ) -> FuncState:
        """The state after one control period under ``action``.

        ``rng`` is for sensor noise, and for when the command arrives.
        """
        own = self.lane_params(self._default(params), state.member)
        shape = (self.arrival_size, *jnp.shape(state.env.q[0]))
        drawn = ()
        if self.arrival_size:
            drawn = tuple(jax.random.uniform(jax.random.fold_in(rng, ARRIVAL), shape, self._dtype))
        env, outcome = self.advance(state.env, self._entries(action), own, drawn)
        fresh = self._standard_noise(rng, jnp.shape(outcome.sampled))
        pairs = zip(fresh, state.noise, strict=True)
        noise = tuple(jnp.where(outcome.sampled, new, held) for new, held in pairs)
        return FuncState(env, outcome, noise, state.member)

    def observation(self, state: FuncState, rng: Any = None, params: Params | None = None) -> Any:
        """The last sensor sample, float32, shape (*lanes, obs)."""
        own = self.lane_params(self._default(params), state.member)
        observed = self.observe(state.env, state.noise, own)
        return jnp.moveaxis(jnp.stack(observed), 0, -1)

    def reward(
        self,
        state: FuncState,
        action: Any,
        next_state: FuncState,
        rng: Any = None,
        params: Params | None = None,
    ) -> Any:
        """Reward of the transition to ``next_state``."""
        return next_state.outcome.reward

    def terminal(self, state: FuncState, rng: Any = None, params: Params | None = None) -> Any:
        """Whether the task or a divergence has ended the episode."""
        return state.outcome.terminated

    def truncated(self, state: FuncState, rng: Any = None, params: Params | None = None) -> Any:
        """Whether the time limit has ended the episode."""
        return state.outcome.truncated

    def state_info(self, state: FuncState, params: Params | None = None) -> dict[str, Any]:
        """`info` of the environment after the transition that led here.

        The keys of the single environment's; ``solver_status`` is a code: 0 ok, 1 not converged,
        2 diverged, -1 not reported.
        """
        setup = self.setup_of(self.lane_params(self._default(params), state.member))
        drawn = dict(zip(("mixture_index",), state.member, strict=False))
        return {**step_info(setup, state.env, state.outcome), **drawn}

    def transition_info(
        self,
        state: FuncState,
        action: Any,
        next_state: FuncState,
        params: Params | None = None,
    ) -> dict[str, Any]:
        """:meth:`state_info` of ``next_state``."""
        return self.state_info(next_state, params)

    def step(
        self, state: FuncState, action: Any, rng: Any, params: Params | None = None
    ) -> tuple[FuncState, TimeStep]:
        """One transition; lanes whose episode ends are reset at once (Gymnasium's `SAME_STEP`)."""
        step_key, reset_key = jax.random.split(rng)
        after = self.transition(state, action, step_key, params)
        outcome = after.outcome
        begun = self.reset_where(outcome.terminated | outcome.truncated, after, reset_key, params)
        return begun, TimeStep(
            observation=self.observation(begun, params=params),
            reward=outcome.reward,
            terminated=outcome.terminated,
            truncated=outcome.truncated,
            final_observation=self.observation(after, params=params),
            info=self.state_info(after, params),
        )

    def reset_where(
        self, ended: Any, state: FuncState, rng: Any, params: Params | None = None
    ) -> FuncState:
        """``state`` with new starts in the lanes of ``ended``; drawn only if there is one."""

        def reset() -> FuncState:
            fresh = self.initial(rng, params, jnp.shape(ended))
            merged: FuncState = jax.tree.map(lambda a, b: jnp.where(ended, a, b), fresh, state)
            return merged

        begun: FuncState = jax.lax.cond(jnp.any(ended), reset, lambda: state)
        return begun

    def _default(self, params: Params | None) -> Params:
        return self.default_params if params is None else params  # type: ignore[return-value]

    def _check_structure(self, structure: Hashable) -> None:
        if structure != self.structure:
            raise InputError(
                f"these arguments need another program ({structure}) than this environment's "
                f"({self.structure}); make another environment"
            )

    def _first(self, env: EnvState, member: Components, rng: Any, params: Params) -> FuncState:
        """The state at time 0: nothing is booked."""
        own = self.lane_params(params, member)
        drawn = (0.0 * env.q[0],) * self.arrival_size
        action = (0.0 * env.q[0],) * self.setup.action_size
        _, outcome = jax.eval_shape(lambda e: self.advance(e, action, own, drawn), env)
        nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), outcome)
        noise = self._standard_noise(rng, jnp.shape(env.q[0]))
        return FuncState(env, nothing, noise, member)

    def _standard_noise(self, rng: Any, shape: tuple[int, ...]) -> Components:
        """Standard normal noise, one component per state component; none without sensor noise."""
        if not self.setup.settings.observation_noise:
            return ()
        size = 2 * len(self.setup.plant.coordinates)
        return tuple(jax.random.normal(rng, (size, *shape), self._dtype))

    def _entries(self, action: Any) -> Components:
        """Of an action: of a `Box` one per control, or the index of a `Discrete`."""
        values = jnp.asarray(action, self._dtype)
        if self.setup.task.discrete is not None:
            return (values,)
        return tuple(jnp.moveaxis(values, -1, 0))

    def _cast(self, tree: Any, shape: tuple[int, ...]) -> Any:
        """All entries with one shape: floats in the environment's type, whole numbers int32."""

        def cast(value: Any) -> Any:
            array = jnp.broadcast_to(jnp.asarray(value), shape)
            kind = array.dtype.kind
            return array if kind == "b" else array.astype("int32" if kind in "iu" else self._dtype)

        return jax.tree.map(cast, tree)


_STEPS = ("dt", "substeps", "sensor")
"""Entries of :class:`Params` that the members of a group may differ in."""

_DECISIONS = ("control_period", "horizon")
"""Entries that members of several control periods differ in, within a group or not."""


class MixtureParams(NamedTuple):
    """What may differ between mixtures that share one program."""

    groups: tuple[tuple[Params, ...], ...]
    """By group and member."""
    bounds: tuple[tuple[Component, ...], ...]
    """By group: where in [0, 1) one member's part ends and the next one's begins."""


@dataclass(frozen=True)
class _Group:
    """Members that one compiled function can advance: in general those of one integrator.

    Attributes:
        env: that of the first member.
        members: their places in the mixture.
        params: of each member.
        share: of the group in the mixture.
        bounds: where in [0, 1) one member's part of the group ends and the next one's begins.
        drawn: entries of :class:`Params` that each of its lanes has of its member.
    """

    env: FunctionalEnv
    members: tuple[int, ...]
    params: tuple[Params, ...]
    share: Fraction
    bounds: tuple[float, ...]
    drawn: tuple[str, ...]


class FunctionalMixture(FunctionalEnv):
    """A functional environment whose lanes run on the members of a mixture.

    Lanes are grouped by integrator, so that each is advanced by its own alone: the last axis of a
    batch is cut into parts, one per integrator (beside it, arguments that need another program of
    their own), in the order in which the mixture names them. A part is as large as its members'
    shares, so that every integrator has its share of the lanes at every moment, exactly and not
    only in expectation. Within its part, every lane draws a member, which means a step ``dt`` and a
    control period, by the shares at every reset.

    Which lanes make up a part never changes. Dealing the integrators out anew among the lanes that
    are reset together would give episodes of the same distribution, as lanes differ in nothing but
    their number. It is a stratified draw: where episodes end early, integrators with short episodes
    have more episodes than their share, where independent draws (those of ``gym.make_vec``) would
    give them fewer decisions.

    Args:
        env_id: a registered id.
        mixture: discretizations (dicts of ``integrator``, ``dt`` and, optionally, ``weight``).
        dtype: float type of the physics.
        arguments: the other constructor arguments.
    """

    def __init__(
        self,
        env_id: str,
        mixture: Sequence[Mapping[str, Any]],
        *,
        dtype: str = "float32",
        **arguments: Any,
    ) -> None:
        drawn = environment_mixture(env_id, {**arguments, "mixture": mixture})
        self._given = {**arguments, "mixture": mixture}
        self._groups = _group_members(env_id, dtype, self._given, drawn)
        super().__init__(env_id, dtype=dtype, **_member_arguments(arguments, mixture[0]))
        self.setup, self.setups, self.shares = drawn.setups[0], drawn.setups, drawn.shares
        self.start_size += 1
        self.structure = _structure_of(self._groups)

    def params(self, **arguments: Any) -> Any:
        """Values of other constructor arguments for the same program.

        Args:
            arguments: replace those that the environment was made with, ``mixture`` included.

        Raises:
            TypeError: for an unknown argument.
            ValueError: for an impossible value, or one that needs another program.
        """
        groups = self._groups
        if arguments:
            given = {**self._given, **arguments}
            drawn = environment_mixture(self.env_id, given)
            groups = _group_members(self.env_id, self._dtype, given, drawn)
            self._check_structure(_structure_of(groups))
        return MixtureParams(
            tuple(group.params for group in groups), tuple(group.bounds for group in groups)
        )

    def columns(self, params: Sequence[MixtureParams]) -> MixtureParams:
        """As that of a single discretization, for every member."""
        single = super().columns
        groups = zip(*(one.groups for one in params), strict=True)
        return MixtureParams(
            tuple(tuple(map(single, zip(*alike, strict=True))) for alike in groups),
            jax.tree.map(lambda *x: np.array(x)[:, None], *(one.bounds for one in params)),
        )

    def check_lanes(self, count: int) -> None:
        """Check that every group can have its share of so many lanes.

        Raises:
            ValueError: if a share is no whole number of lanes, with the numbers that would do.
        """
        unit = math.lcm(*(group.share.denominator for group in self._groups))
        if count % unit or not count:
            parts = ", ".join(f"{g.env.setup.settings.integrator} {g.share}" for g in self._groups)
            raise InputError(
                f"{count} environments cannot be shared out among the integrators of the mixture "
                f"({parts}); their number (`n_envs`) must be a multiple of {unit}"
            )

    def lane_params(self, params: Any, member: Components) -> tuple[Params, ...]:
        """By group, the values that hold in each of its lanes.

        Args:
            params: see :meth:`params`.
            member: (the member of every lane,), shape (…, lanes).

        Raises:
            ValueError: if the lanes cannot be shared out; see :meth:`check_lanes`.
        """
        (members,) = member
        parts = zip(self._groups, params.groups, self._parts(members), strict=True)
        return tuple(_select_options(group, options, part) for group, options, part in parts)

    def fresh(self, drawn: Components, params: Any) -> tuple[EnvState, Components]:
        """Episodes that start anew: the last number draws the member of each lane's group."""
        *numbers, last = drawn
        parts = zip(self._groups, params.bounds, self._parts(last), strict=True)
        drawn_by = [_member(part, group.members, bounds) for group, bounds, part in parts]
        member = jnp.concatenate(drawn_by, axis=-1)
        own = self.lane_params(params, (member,))
        return self.begin(self.start(tuple(numbers), own), own), (member,)

    def common(self, params: Any) -> Params:
        """Those of the first group: all but the discretization is common to the members.

        Where they decide at several periods, each lane has its own control period.
        """
        first: Params = params[0]
        if not set(_DECISIONS) & set(self._groups[0].drawn):
            return first
        periods = [own.control_period for own in params]
        return first._replace(control_period=jnp.concatenate(periods, axis=-1))

    def advance(
        self, env: EnvState, action: Components, params: Any, drawn: Components = ()
    ) -> tuple[EnvState, Outcome]:
        """One control period, each part of the lanes by its group's integrator alone.

        Args:
            env: components of shape (…, lanes).
            action: one entry per control, or an action's index, of that shape.
            params: see :meth:`lane_params`.
            drawn: see :meth:`FunctionalEnv.advance`.
        """
        count = env.q[0].shape[-1]
        advanced = [
            group.env.advance(*_of_lanes((env, action, own, drawn), lanes, count))
            for group, own, lanes in zip(self._groups, params, self._slices(count), strict=True)
        ]
        return jax.tree.map(lambda *parts: jnp.concatenate(parts, axis=-1), *advanced)  # type: ignore[no-any-return]

    def _slices(self, count: int) -> list[slice]:
        """The part of ``count`` lanes that each group has."""
        self.check_lanes(count)
        ends = accumulate((int(group.share * count) for group in self._groups), initial=0)
        return [slice(*ends) for ends in pairwise(ends)]

    def _parts(self, values: Component) -> list[Component]:
        """Values of shape (…, lanes), by group."""
        if jnp.ndim(values) == 0:
            raise InputError("a mixture needs a batch of environments; give lanes=(n,)")
        return [values[..., lanes] for lanes in self._slices(values.shape[-1])]


def make(
    env_id: str,
    *,
    dtype: str = "float32",
    mixture: Sequence[Mapping[str, Any]] | None = None,
    **arguments: Any,
) -> FunctionalEnv:
    """The functional form of an environment.

    Args:
        env_id: a registered id.
        dtype: float type of the physics, ``"float32"`` or ``"float64"``; observations are float32.
        mixture: as for ``gym.make_vec``; see
            :class:`integ_gym.envs.functional.FunctionalMixture` for what is
            drawn when.
        arguments: those of ``gym.make``, but for ``render_mode``.

    Raises:
        TypeError: for an unknown argument.
        ValueError: for an impossible value, an engine outside JAX or its own stops, or float64
            outside JAX's 64-bit mode.
        ModuleNotFoundError: without JAX, with the command that installs it.
    """
    if mixture is None:
        return FunctionalEnv(env_id, dtype=dtype, **arguments)
    return FunctionalMixture(env_id, mixture, dtype=dtype, **arguments)


def _group_members(
    env_id: str, dtype: str, arguments: Mapping[str, Any], mixture: Mixture
) -> tuple[_Group, ...]:
    """Members that share a program, by the order of their first."""
    shares = mixture.shares
    drawn = (*_STEPS, *_DECISIONS) if mixture.several_periods else _STEPS
    envs = [
        FunctionalEnv(env_id, dtype=dtype, **_member_arguments(arguments, member))
        for member in arguments["mixture"]
    ]
    places: dict[Hashable, list[int]] = {}
    for place, env in enumerate(envs):
        env.setup = mixture.setups[place]
        places.setdefault(env.structure, []).append(place)
    groups = []
    for members in places.values():
        *bounds, total = accumulate(shares[k] for k in members)
        ends = tuple(float(bound / total) for bound in bounds)
        params = tuple(envs[k].params() for k in members)
        groups.append(_Group(envs[members[0]], tuple(members), params, total, ends, drawn))
    return tuple(groups)


def _member_arguments(arguments: Mapping[str, Any], member: Mapping[str, Any]) -> dict[str, Any]:
    """Constructor arguments of one member's own environment."""
    return {k: x for k, x in {**arguments, **member}.items() if k not in ("mixture", WEIGHT)}


def _structure_of(groups: Sequence[_Group]) -> Hashable:
    return tuple((g.env.structure, (g.members, g.share, g.drawn)) for g in groups)


def _member(number: Component, members: Sequence[int], bounds: Sequence[Component]) -> Component:
    """The member that each number from [0, 1) stands for, int32."""
    member = jnp.full(number.shape, members[0], jnp.int32)
    for index, bound in zip(members[1:], bounds, strict=True):
        member = jnp.where(number >= bound, index, member)
    return member


def _select_options(group: _Group, options: Sequence[Params], drawn: Component) -> Params:
    """One group's values, those of the member that each lane has drawn."""
    chosen = options[0]
    values: dict[str, Any] = {
        name: jnp.broadcast_to(getattr(chosen, name), drawn.shape)
        for name in _DECISIONS
        if name in group.drawn
    }
    chosen = chosen._replace(**values)
    for index, other in zip(group.members[1:], options[1:], strict=True):
        here = drawn == index
        values = {
            name: jnp.where(here, getattr(other, name), getattr(chosen, name))
            for name in group.drawn
            if getattr(chosen, name) is not None
        }
        chosen = chosen._replace(**values)
    return chosen


def _of_lanes(tree: Any, lanes: slice, count: int) -> Any:
    """Entries that have one value for each of ``count`` lanes, for some of them."""

    def part(value: Any) -> Any:
        varied = jnp.ndim(value) > 0 and value.shape[-1] == count
        return value[..., lanes] if varied else value

    return jax.tree.map(part, tree)
