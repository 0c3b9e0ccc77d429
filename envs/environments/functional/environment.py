"""An environment as pure functions of JAX arrays."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from gymnasium.experimental.functional import FuncEnv

from ...arithmetic.jax_ops import JaxOps, jax, jnp
from ...arithmetic.ops import Component, Components
from ...catalogue.lookup import environment_setup
from ...episode.control_period import (
    EnvState,
    Outcome,
    initial_state,
    sensed,
    transition,
)
from ...episode.info import step_info
from ...episode.settings import Setup
from ...plants.interface import join_state, split_state
from ..environment import observation_space
from .params import Params, params_of, structure_of, traced_setup

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


def checked_setup(env_id: str, arguments: Mapping[str, Any]) -> Setup:
    """The setup, if JAX can advance it.

    Raises:
        TypeError, ValueError: see :func:`integ_gym.envs.environments.functional.make`.
    """
    if arguments.get("contact") == "engine":
        raise ValueError(
            "the functional environment has no `contact`='engine'; use 'compliant', the same law "
            "in every engine, or gym.make or gym.make_vec"
        )
    setup = environment_setup(env_id, arguments)
    if not setup.engine.batched:
        raise ValueError(
            "the functional environment needs an engine made of JAX's operations, 'native' or "
            f"'mjx', got {setup.settings.engine!r}; use gym.make or gym.make_vec"
        )
    return setup


class FunctionalEnv(FuncEnv[FuncState, Any, Any, Any, Any, Any, Params]):
    """An environment as pure functions; see :func:`integ_gym.envs.environments.functional.make`.

    All functions take a single environment or a batch: components of shape ``lanes``, actions of
    shape (*lanes, 1) for a `Box` and ``lanes`` for a `Discrete` space. A `Discrete` action that is
    none of the choices cannot raise here and counts as 0; a non-finite one calls the fallback.

    Attributes:
        setup: plant, task, timing and engine with the constructor's values.
        setups: all that an episode may run on; more than one in a mixture.
        shares: of each of them.
        structure: what a compiled function depends on.
        start_size: numbers that a start is made of.
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
            raise ValueError(f"`dtype` must be one of {', '.join(DTYPES)}, got {dtype!r}")
        if dtype == "float64" and not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
            raise ValueError(
                "float64 needs JAX's 64-bit mode; make and use the environment inside "
                "`with jax.enable_x64(True):`"
            )
        self.env_id = env_id
        self._arguments = arguments
        self._dtype = dtype
        self._ops = JaxOps(dtype)
        self.setup = checked_setup(env_id, arguments)
        self.setups: tuple[Setup, ...] = (self.setup,)
        self.shares: tuple[Fraction, ...] = (Fraction(1),)
        self.start_size = 2 * len(self.setup.plant.coordinates)
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
        setup = checked_setup(self.env_id, {**self._arguments, **arguments})
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
        """Check that so many lanes can be advanced together.

        Raises:
            ValueError: if a mixture cannot share them out.
        """

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
            state: in Gymnasium's order, SI units, shape (*lanes, n).
            rng: JAX key, for the sensor noise.
            params: defaults to the environment's own.
            member: in a mixture: (the member of each lane,), int32, shape ``lanes``.
        """
        start = tuple(jnp.moveaxis(jnp.asarray(state, self._dtype), -1, 0))
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
        return traced_setup(self.setup, self.common(params))

    def start(self, drawn: Components, params: Any) -> Components:
        """A start in state order, SI units, made of numbers from [0, 1), one per component."""
        own = self.common(params)
        limits = zip(drawn, own.start_low, own.start_high, strict=True)
        q, v = split_state(tuple(low + x * (high - low) for x, low, high in limits))
        return join_state(self.setup_of(params).system.confined(self._ops, q), v)

    def begin(self, start: Components, params: Any) -> EnvState:
        """Episodes that start in ``start``, in state order, components of one shape."""
        q, v = split_state(start)
        fresh = initial_state(self._ops, self.setup_of(params), q, v)
        return self._typed(fresh, jnp.shape(q[0]))  # type: ignore[no-any-return]

    def advance(
        self, env: EnvState, control: Component, params: Params
    ) -> tuple[EnvState, Outcome]:
        """One control period, without the sensor's noise.

        Args:
            env: components of one shape.
            control: torque, force or action index, of that shape.
            params: values that broadcast against it.
        """
        after = transition(self._ops, self.setup_of(params), env, control)
        return self._typed(after, jnp.shape(env.q[0]))  # type: ignore[no-any-return]

    def observe(self, env: EnvState, noise: Components, params: Any) -> Components:
        """The last sensor sample, one float32 component per observation.

        Args:
            env: episode state.
            noise: standard noise of the sample, one component per state component, or empty.
            params: scale of the noise.
        """
        own = self.common(params)
        q, v = sensed(env, tuple(own.observation_noise * x for x in noise))
        task = self.setup_of(params).task
        observed = tuple(x.astype(jnp.float32) for x in task.observe(self._ops, q, v))
        if not noise:
            return observed
        limits = zip(observed, task.observation_limits(own.max_speed), strict=True)
        return tuple(jnp.clip(x, -limit, limit).astype(jnp.float32) for x, limit in limits)

    def transition(
        self, state: FuncState, action: Any, rng: Any, params: Params | None = None
    ) -> FuncState:
        """The state after one control period under ``action``; ``rng`` is for sensor noise."""
        own = self.lane_params(self._default(params), state.member)
        env, outcome = self.advance(state.env, self._control(action), own)
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
            raise ValueError(
                f"these arguments need another program ({structure}) than this environment's "
                f"({self.structure}); make another environment"
            )

    def _first(self, env: EnvState, member: Components, rng: Any, params: Params) -> FuncState:
        """The state at time 0: nothing is booked."""
        own = self.lane_params(params, member)
        _, outcome = jax.eval_shape(lambda e: self.advance(e, 0.0 * e.q[0], own), env)
        nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), outcome)
        noise = self._standard_noise(rng, jnp.shape(env.q[0]))
        return FuncState(env, nothing, noise, member)

    def _standard_noise(self, rng: Any, shape: tuple[int, ...]) -> Components:
        """Standard normal noise, one component per state component; none without sensor noise."""
        if not self.setup.settings.observation_noise:
            return ()
        size = 2 * len(self.setup.plant.coordinates)
        return tuple(jax.random.normal(rng, (size, *shape), self._dtype))

    def _control(self, action: Any) -> Component:
        values = jnp.asarray(action, self._dtype)
        return values if self.setup.task.discrete is not None else values[..., 0]

    def _typed(self, tree: Any, shape: tuple[int, ...]) -> Any:
        """All entries with one shape: floats in the environment's type, whole numbers int32."""

        def typed(value: Any) -> Any:
            array = jnp.broadcast_to(jnp.asarray(value), shape)
            kind = array.dtype.kind
            return array if kind == "b" else array.astype("int32" if kind in "iu" else self._dtype)

        return jax.tree.map(typed, tree)
