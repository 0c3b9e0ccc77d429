"""PPO of many policies as one compiled program.

One call of :meth:`FleetProgram.iterate` collects a rollout and updates every policy of a *chunk*
from it. The algorithm is that of stable-baselines3's PPO, which `integ_gym.train.ppo` runs.
Arrays are (policies, …); within a network, batches are the last axis, which is the fastest order
for small matrix products on a CPU.

Source: Schulman et al. (2017), *Proximal policy optimization algorithms*, arXiv:1707.06347.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from integ_gym.envs.functional import FunctionalEnv, Params
from integ_gym.envs.ops.jax_ops import jax, jnp
from integ_gym.envs.ops.ops import Components, join_state
from integ_gym.envs.starts import ARRIVAL
from integ_gym.envs.transition import EnvState, Outcome, reset_info, step_info
from integ_gym.evidence.episodes import Layout

from . import learning

Array = Any


class _Draws(NamedTuple):
    """Random numbers of a rollout, steps first."""

    actions: Array
    starts: Array
    noise: Array
    arrivals: Array


class _Step(NamedTuple):
    """What the scan over steps keeps."""

    env: EnvState
    noise: Components
    member: Components
    action: Array
    log_prob: Array
    terminated: Array
    truncated: Array
    fresh: Array
    arrivals: Array


class FleetProgram:
    """The compiled functions for one structure; policies and their values are arguments.

    Args:
        env: what the structure of the environment is taken from.
        algorithm: the structure of the learner.
        layout: of evidence rows; None for no evidence.
        in_turn: one after the other where all at once is no faster, as on a core of a CPU: its
            cache holds one policy at a time.
    """

    def __init__(
        self,
        env: FunctionalEnv,
        algorithm: learning.Algorithm,
        layout: Layout | None = None,
        in_turn: bool = True,
    ) -> None:
        self.env = env
        self.algorithm = algorithm
        self.layout = layout
        self.discrete = env.setup.task.discrete is not None
        self.in_turn = in_turn
        self.begin: Callable[..., learning.Learner] = jax.jit(self._begin)
        """The state before the first rollout."""
        self.iterate: Any = jax.jit(self._iterate, donate_argnums=0)
        """Collect one rollout and learn from it."""

    def _begin(self, stack: learning.Stack, keys: Array, params: Params) -> learning.Learner:
        zeros = jax.tree.map(jnp.zeros_like, stack)
        lanes = (stack.log_std.shape[0], self.algorithm.n_envs)
        first, keys = learning.split(keys, 2)
        drawn = learning.draw(
            jax.random.uniform, first, (self.env.start_size, self.algorithm.n_envs)
        )
        env, member = self.env.fresh(tuple(jnp.moveaxis(drawn, 1, 0)), params)
        noise: Components = ()
        if self._noise_size:
            later, keys = learning.split(keys, 2)
            drawn = learning.draw(jax.random.normal, later, (self._noise_size, lanes[1]))
            noise = tuple(jnp.moveaxis(drawn, 1, 0))
        adam = learning.Adam(zeros, zeros, jnp.zeros(lanes[:1]))
        return learning.Learner(stack, adam, env, noise, member, keys, jnp.int32(0))

    def _iterate(
        self, learner: learning.Learner, knobs: learning.Knobs, params: Params
    ) -> tuple[learning.Learner, learning.Trail]:
        keys = jax.vmap(lambda key: jax.random.fold_in(key, learner.iteration))(learner.keys)
        drawing, shuffling = learning.split(keys, 2)
        (env, noise, member), steps = self._collect(learner, drawing, params)
        after, outcome, observed, observed_after = self._again(steps, params)
        batch = self._batch(learner.stack, knobs, steps, outcome, (observed, observed_after))
        iteration = learner.iteration + 1
        rate = learning.learning_rate(self.algorithm, knobs, iteration)
        orders = learning.permutations(self.algorithm, shuffling)
        stack, adam = self._each(
            partial(learning.update, self.algorithm),
            (learner.stack, learner.adam, batch, orders, knobs, rate),
        )
        trail = self._trail(steps, after, outcome, observed, observed_after, params)
        return learning.Learner(stack, adam, env, noise, member, learner.keys, iteration), trail

    def _each(self, function: Callable[..., Any], given: tuple[Any, ...]) -> Any:
        """``function`` of all policies, or of one policy after the other if :attr:`in_turn`.

        Args:
            function: of arrays whose first axis counts policies, to such arrays.
            given: what it is applied to.
        """
        if not self.in_turn:
            return function(*given)

        def one(given: Any) -> Any:
            alone = function(*jax.tree.map(lambda x: x[None], given))
            return jax.tree.map(lambda x: x[0], alone)

        return jax.lax.map(one, given)

    @property
    def _noise_size(self) -> int:
        noisy = self.env.setup.settings.observation_noise > 0.0
        return 2 * len(self.env.setup.plant.coordinates) if noisy else 0

    def _draws(self, stack: learning.Stack, keys: Array) -> _Draws:
        for_actions, for_starts, for_noise = learning.split(keys, 3)
        for_arrivals = jax.vmap(lambda key: jax.random.fold_in(key, ARRIVAL))(keys)
        steps, lanes = self.algorithm.n_steps, self.algorithm.n_envs
        size = stack.weights[-1].shape[2]

        def drawn(sample: Callable[..., Array], keys: Array, size: int) -> Array:
            return jnp.moveaxis(learning.draw(sample, keys, (steps, size, lanes)), 1, 0)

        return _Draws(
            drawn(jax.random.gumbel if self.discrete else jax.random.normal, for_actions, size),
            drawn(jax.random.uniform, for_starts, self.env.start_size),
            drawn(jax.random.normal, for_noise, 2 * self._noise_size),
            drawn(jax.random.uniform, for_arrivals, self.env.arrival_size),
        )

    def _collect(
        self, learner: learning.Learner, keys: Array, params: Params
    ) -> tuple[tuple[EnvState, Components, Components], _Step]:
        """Act for one rollout; episodes that end are followed by new ones at once.

        Returns:
            State, noise and members afterwards, and the steps.
        """
        actor = learning.one_side(learner.stack, 0)
        draws = self._draws(learner.stack, keys)

        def step(carry: tuple[EnvState, Components, Components], drawn: _Draws) -> Any:
            env, noise, member = carry
            own = self.env.lane_params(params, member)
            observed = jnp.stack(self.env.observe(env, noise, own), axis=1)
            head = learning.outputs(actor, self.algorithm.activation, observed)[:, 0]
            action = self._sample(head, learner.stack.log_std, drawn.actions)
            log_prob, _ = learning.log_prob_and_entropy(head, learner.stack.log_std, action)
            arrivals = tuple(jnp.moveaxis(drawn.arrivals, 1, 0))
            after, outcome = self.env.advance(env, self._entries(action, own), own, arrivals)
            ending = outcome.terminated, outcome.truncated
            ended = outcome.terminated | outcome.truncated
            fresh = tuple(jnp.moveaxis(drawn.noise, 1, 0))
            begun = self.env.fresh(tuple(jnp.moveaxis(drawn.starts, 1, 0)), params)
            next_env, next_member = jax.tree.map(
                lambda a, b: jnp.where(ended, a, b), begun, (after, member)
            )
            half = self._noise_size
            next_noise = _where(outcome.sampled, fresh[:half], noise)
            next_noise = _where(ended, fresh[half:], next_noise)
            draws = drawn.noise, drawn.arrivals
            kept = _Step(env, noise, member, action, log_prob, *ending, *draws)
            return (next_env, next_noise, next_member), kept

        return jax.lax.scan(step, (learner.env, learner.noise, learner.member), draws)

    def _sample(self, head: Array, log_std: Array, drawn: Array) -> Array:
        if self.discrete:
            return jnp.argmax(head + drawn, axis=1, keepdims=True).astype(jnp.float32)
        return head + jnp.exp(log_std)[..., None] * drawn

    def _entries(self, action: Array, own: Any) -> Components:
        """Clipped to the action space, as the environment gets them, each (…, policies, n_envs)."""
        entries = tuple(jnp.moveaxis(action, -2, 0))
        if self.discrete:
            return entries
        limits = self.env.setup_of(own).task.control_limits
        return tuple(jnp.clip(x, *ends) for x, ends in zip(entries, limits, strict=True))

    def _again(self, steps: _Step, params: Params) -> tuple[EnvState, Outcome, Array, Array]:
        """All transitions of the rollout, and the observations before and after them.

        The scan keeps states and actions only; this gives everything that follows from them. All at
        once, every transition would take as many iterations as the one that takes most of them.
        """
        after, outcome, *observed = self._each(
            lambda steps: self._transitions(steps, params), (steps,)
        )
        before, later = (jnp.swapaxes(components, 0, 1) for components in observed)
        return after, outcome, before, later

    def _transitions(self, steps: _Step, params: Params) -> tuple[EnvState, Outcome, Array, Array]:
        own = self.env.lane_params(params, steps.member)
        action = self._entries(steps.action, own)
        arrivals = tuple(jnp.moveaxis(steps.arrivals, 2, 0))
        after, outcome = self.env.advance(steps.env, action, own, arrivals)
        outcome = outcome._replace(terminated=steps.terminated, truncated=steps.truncated)
        fresh = tuple(jnp.moveaxis(steps.fresh, 2, 0))[: self._noise_size]
        noise = _where(outcome.sampled, fresh, steps.noise)
        before = jnp.stack(self.env.observe(steps.env, steps.noise, own), axis=1)
        return after, outcome, before, jnp.stack(self.env.observe(after, noise, own), axis=1)

    def _batch(
        self,
        stack: learning.Stack,
        knobs: learning.Knobs,
        steps: _Step,
        outcome: Outcome,
        observed: tuple[Array, Array],
    ) -> learning.Batch:
        """Advantages and returns; an episode cut off by the time limit is bootstrapped."""
        before, after = (_flat(x) for x in observed)
        critic = learning.one_side(stack, 1)
        shape = outcome.reward.shape

        def value_of(critic: learning.Stack, observations: Array) -> Array:
            return learning.outputs(critic, self.algorithm.activation, observations)[:, 0, 0]

        def value(observations: Array) -> Array:
            values = self._each(value_of, (critic, observations))
            return jnp.moveaxis(values.reshape(shape[1], shape[2], shape[0]), -1, 0)

        values, next_values = value(before), value(after)
        reward = outcome.reward.astype(jnp.float32) * knobs.reward_scale[:, None]
        ending = steps.terminated, steps.truncated
        member = _member_of(steps)
        advantages = learning.advantages_of(reward, values, next_values, *ending, knobs, member)
        return learning.Batch(
            before,
            _flat(jnp.moveaxis(steps.action, 2, 0)),
            _flat(steps.log_prob[None])[:, 0],
            _flat(advantages[None])[:, 0],
            _flat((advantages + values)[None])[:, 0],
        )

    def _trail(
        self,
        steps: _Step,
        after: EnvState,
        outcome: Outcome,
        before_observed: Array,
        after_observed: Array,
        params: Params,
    ) -> learning.Trail:
        rows = first = jnp.zeros((0,))
        if self.layout is not None:
            setup = self.env.setup_of(self.env.lane_params(params, steps.member))
            ending = outcome.reward, outcome.terminated, outcome.truncated
            info, state = step_info(setup, after, outcome), join_state(after.q, after.v)
            rows = _stack(self.layout.row(info, outcome.status, ending, state, after_observed))
            info = reset_info(self.env.setup, steps.env)
            state = join_state(steps.env.q, steps.env.v)
            first = _stack(self.layout.start(info, state, before_observed))
        return learning.Trail(
            outcome.reward,
            outcome.terminated | outcome.truncated,
            outcome.success,
            steps.env.steps == 0,
            _member_of(steps),
            rows,
            first,
        )


def _member_of(steps: _Step) -> Array:
    """The member of the mixture that each step was taken on, int32; 0 without one."""
    return steps.member[0] if steps.member else jnp.zeros_like(steps.env.steps)


def _flat(values: Array) -> Array:
    """(k, n_steps, policies, n_envs) to (policies, k, n_envs · n_steps), as SB3 orders them."""
    k, steps, policies, lanes = values.shape
    return values.transpose(2, 0, 3, 1).reshape(policies, k, lanes * steps)


def _where(condition: Array, new: Components, old: Components) -> Components:
    return tuple(jnp.where(condition, a, b) for a, b in zip(new, old, strict=True))


def _stack(entries: tuple[Array, ...]) -> Array:
    return jnp.stack([x.astype(jnp.float32) for x in entries])
