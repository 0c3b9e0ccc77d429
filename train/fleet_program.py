"""PPO of many policies as one compiled program.

One call of :meth:`FleetProgram.iterate` collects a rollout and updates every policy of a *chunk*
from it. The algorithm is that of stable-baselines3's PPO, which `integ_gym.train.ppo` runs.
Arrays are (policies, …); within a network, batches are the last axis, which is the fastest order
for small matrix products on a CPU.

Source: Schulman et al. (2017), *Proximal policy optimization algorithms*, arXiv:1707.06347.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

from integ_gym.envs.functional import FunctionalEnv, Params
from integ_gym.envs.info import booked
from integ_gym.envs.jax_ops import jax, jnp
from integ_gym.envs.ops import Components
from integ_gym.envs.plants.interface import join_state, state_names
from integ_gym.envs.transition import EnvState, Outcome
from integ_gym.train.network import Stack

Array = Any

ADAM_DECAY = (0.9, 0.999)
ADAM_EPSILON = 1e-5
_NORM_EPSILON = 1e-6
_ADVANTAGE_EPSILON = 1e-8
_LOG_ROOT_2PI = 0.5 * math.log(2.0 * math.pi)
_INDEX_BITS = 16
"""Rollouts up to 2 to this many decisions are shuffled by one packed sort."""

ACTIVATIONS: dict[str, Callable[[Array], Array]] = {
    "Tanh": jnp.tanh,
    "ReLU": jax.nn.relu,
    "ReLU6": jax.nn.relu6,
    "LeakyReLU": partial(jax.nn.leaky_relu, negative_slope=0.01),
    "ELU": jax.nn.elu,
    "SELU": jax.nn.selu,
    "SiLU": jax.nn.silu,
    "GELU": partial(jax.nn.gelu, approximate=False),
    "Mish": jax.nn.mish,
    "Sigmoid": jax.nn.sigmoid,
    "Softplus": jax.nn.softplus,
    "Softsign": jax.nn.soft_sign,
}


@dataclass(frozen=True)
class Algorithm:
    """Hyperparameters that decide the program's structure; named as in `PPOConfig`."""

    n_envs: int
    n_steps: int
    batch_size: int
    n_epochs: int
    activation: str
    normalize_advantage: bool
    stops_early: bool
    """Whether there is a `target_kl`."""

    @property
    def rollout(self) -> int:
        """Decisions of one policy between two updates."""
        return self.n_envs * self.n_steps


class Knobs(NamedTuple):
    """Hyperparameters that are values, float32, shape (policies,); named as in `PPOConfig`."""

    learning_rate: Array
    learning_rate_end: Array
    total_steps: Array
    gamma: Array
    gae_lambda: Array
    clip_range: Array
    ent_coef: Array
    vf_coef: Array
    max_grad_norm: Array
    target_kl: Array
    reward_scale: Array


class Adam(NamedTuple):
    """State of the optimizer."""

    mean: Stack
    square: Stack
    count: Array
    """Steps taken, float32, shape (policies,)."""


class Learner(NamedTuple):
    """All that a chunk carries from one rollout to the next."""

    stack: Stack
    adam: Adam
    env: EnvState
    """Components of shape (policies, n_envs)."""
    noise: Components
    member: Components
    """In a mixture: the member that each lane has drawn, int32; else empty."""
    keys: Array
    """Random keys, shape (policies,)."""
    iteration: Array
    """Rollouts so far, int32."""


class Batch(NamedTuple):
    """Decisions to learn from; the last axis counts them."""

    observations: Array
    """(policies, obs, n)."""
    actions: Array
    """(policies, action_dim, n): before clipping; or (policies, 1, n): number of the action."""
    log_probs: Array
    """(policies, n)."""
    advantages: Array
    returns: Array


class Trail(NamedTuple):
    """What a rollout did, arrays of shape (n_steps, policies, n_envs)."""

    rewards: Array
    """Unscaled."""
    ended: Array
    success: Array
    begun: Array
    """Whether an episode begins with this step."""
    member: Array
    """The member of the mixture that the episode runs on, int32; 0 without one."""
    rows: Array
    """Evidence after each step, (entries, n_steps, policies, n_envs)."""
    first_rows: Array
    """Evidence before each step, of the entries that are not zero after a reset."""


class _Draws(NamedTuple):
    """Random numbers of a rollout, steps first."""

    actions: Array
    starts: Array
    noise: Array


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


@jax.custom_vjp
def affine(weight: Array, bias: Array, x: Array) -> Array:
    """W x + b for stacks: (…, o, i), (…, o), (…, i, n) to (…, o, n)."""
    return weight @ x + bias[..., None]


def _affine_forward(weight: Array, bias: Array, x: Array) -> tuple[Array, tuple[Array, Array]]:
    return affine(weight, bias, x), (weight, x)


def _affine_backward(kept: tuple[Array, Array], dy: Array) -> tuple[Array, Array, Array]:
    """Sums over the batch as matrix products, which XLA does faster than its own reductions."""
    weight, x = kept
    dw = jnp.einsum("...on,...in->...oi", dy, x)
    db = jnp.einsum("...on,n->...o", dy, jnp.ones(dy.shape[-1], dy.dtype))
    if weight.shape[-2] <= 2:
        dx = sum(weight[..., o, :, None] * dy[..., o, None, :] for o in range(weight.shape[-2]))
    else:
        dx = jnp.einsum("...oi,...on->...in", weight, dy)
    return dw, db, dx


affine.defvjp(_affine_forward, _affine_backward)


def outputs(stack: Stack, activation: str, observations: Array) -> Array:
    """What the last layers give.

    Args:
        stack: weights; their second axis may be 1, for actor or critic alone.
        activation: key of `ACTIVATIONS`.
        observations: (policies, obs, n).

    Returns:
        (policies, 2, outputs, n), actor first.
    """
    sides = stack.weights[0].shape[1]
    features: Array = observations
    for layer, (weight, bias) in enumerate(zip(stack.weights, stack.biases, strict=True)):
        if layer:
            features = affine(weight, bias, ACTIVATIONS[activation](features))
        else:
            policies, _, out, width = weight.shape
            joint = affine(
                weight.reshape(policies, sides * out, width), bias.reshape(policies, -1), features
            )
            features = joint.reshape(policies, sides, out, -1)
    return features


def one_side(stack: Stack, side: int) -> Stack:
    """The actors (0) or the critics (1) alone."""
    return stack._replace(
        weights=tuple(w[:, side : side + 1] for w in stack.weights),
        biases=tuple(b[:, side : side + 1] for b in stack.biases),
    )


def log_prob_and_entropy(head: Array, log_std: Array, actions: Array) -> tuple[Array, Array]:
    """Of actions under the actor's outputs.

    Args:
        head: (policies, outputs, n): means, or logits where ``log_std`` is empty.
        log_std: (policies, action_dim).
        actions: as in :class:`Batch`.

    Returns:
        (policies, n), and the entropy: the same shape, or (policies, 1).
    """
    if log_std.shape[1]:
        spread = log_std[..., None]
        scaled = (actions - head) * jnp.exp(-spread)
        log_prob = (-0.5 * scaled * scaled - spread - _LOG_ROOT_2PI).sum(1)
        return log_prob, (0.5 + _LOG_ROOT_2PI + spread).sum(1)
    normalized = jax.nn.log_softmax(head, axis=1)
    chosen = jnp.arange(head.shape[1])[:, None] == actions
    log_prob = jnp.where(chosen, normalized, 0.0).sum(1)
    return log_prob, -(jnp.exp(normalized) * normalized).sum(1)


class FleetProgram:
    """The compiled functions for one structure; policies and their values are arguments.

    Args:
        env: what the structure of the environment is taken from.
        algorithm: the structure of the learner.
        entries: entries of an evidence row, in order; empty for no evidence.
        first_entries: those that are not zero after a reset.
        in_turn: whether policies learn one after the other, each of which fits a core's cache, or
            all at once.
    """

    def __init__(
        self,
        env: FunctionalEnv,
        algorithm: Algorithm,
        entries: tuple[str, ...] = (),
        first_entries: tuple[str, ...] = (),
        in_turn: bool = True,
    ) -> None:
        self.env = env
        self.algorithm = algorithm
        self.entries = entries
        self.first_entries = first_entries
        self.discrete = env.setup.task.discrete is not None
        self.in_turn = in_turn

    @cached_property
    def iterate(self) -> Callable[[Learner, Knobs, Params], tuple[Learner, Trail]]:
        """Compiled: collect one rollout and learn from it."""
        compiled: Any = jax.jit(self._iterate, donate_argnums=0)
        return compiled  # type: ignore[no-any-return]

    @cached_property
    def begin(self) -> Callable[[Stack, Array, Params], Learner]:
        """Compiled: the state before the first rollout."""
        compiled: Any = jax.jit(self._begin)
        return compiled  # type: ignore[no-any-return]

    def _begin(self, stack: Stack, keys: Array, params: Params) -> Learner:
        zeros = jax.tree.map(jnp.zeros_like, stack)
        lanes = (stack.log_std.shape[0], self.algorithm.n_envs)
        first, keys = _split(keys, 2)
        drawn = _draw(jax.random.uniform, first, (self.env.start_size, self.algorithm.n_envs))
        env, member = self.env.fresh(tuple(jnp.moveaxis(drawn, 1, 0)), params)
        noise: Components = ()
        if self._noise_size:
            later, keys = _split(keys, 2)
            drawn = _draw(jax.random.normal, later, (self._noise_size, lanes[1]))
            noise = tuple(jnp.moveaxis(drawn, 1, 0))
        adam = Adam(zeros, zeros, jnp.zeros(lanes[:1]))
        return Learner(stack, adam, env, noise, member, keys, jnp.int32(0))

    def _iterate(self, learner: Learner, knobs: Knobs, params: Params) -> tuple[Learner, Trail]:
        keys = jax.vmap(lambda key: jax.random.fold_in(key, learner.iteration))(learner.keys)
        drawing, shuffling = _split(keys, 2)
        (env, noise, member), steps = self._collect(learner, drawing, params)
        after, outcome, observed, observed_after = self._again(steps, params)
        batch = self._batch(learner.stack, knobs, steps, outcome, (observed, observed_after))
        iteration = learner.iteration + 1
        rate = self._learning_rate(knobs, iteration)
        orders = jnp.swapaxes(self._permutations(shuffling), 0, 1)
        stack, adam = self._each(
            self._learn, (learner.stack, learner.adam, batch, orders, knobs, rate)
        )
        trail = self._trail(steps, after, outcome, observed, observed_after, params)
        return Learner(stack, adam, env, noise, member, learner.keys, iteration), trail

    def _learn(
        self, stack: Stack, adam: Adam, batch: Batch, orders: Array, knobs: Knobs, rate: Array
    ) -> tuple[Stack, Adam]:
        """:meth:`update`, with the axis of policies first in all arrays."""
        return self.update(stack, adam, batch, jnp.swapaxes(orders, 0, 1), knobs, rate)

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

    def _learning_rate(self, knobs: Knobs, iteration: Array) -> Array:
        """Linear in the share of decisions taken, after the rollout that is learned from."""
        done = jnp.minimum(iteration * self.algorithm.rollout / knobs.total_steps, 1.0)
        return knobs.learning_rate + done * (knobs.learning_rate_end - knobs.learning_rate)

    def _draws(self, stack: Stack, keys: Array) -> _Draws:
        for_actions, for_starts, for_noise = _split(keys, 3)
        steps, lanes = self.algorithm.n_steps, self.algorithm.n_envs
        size = stack.weights[-1].shape[2]
        sample = jax.random.gumbel if self.discrete else jax.random.normal
        return _Draws(
            jnp.moveaxis(_draw(sample, for_actions, (steps, size, lanes)), 1, 0),
            jnp.moveaxis(
                _draw(jax.random.uniform, for_starts, (steps, self.env.start_size, lanes)), 1, 0
            ),
            jnp.moveaxis(
                _draw(jax.random.normal, for_noise, (steps, 2 * self._noise_size, lanes)), 1, 0
            ),
        )

    def _collect(
        self, learner: Learner, keys: Array, params: Params
    ) -> tuple[tuple[EnvState, Components, Components], _Step]:
        """Act for one rollout; episodes that end are followed by new ones at once.

        Returns:
            State, noise and members afterwards, and the steps.
        """
        actor = one_side(learner.stack, 0)
        draws = self._draws(learner.stack, keys)

        def step(carry: tuple[EnvState, Components, Components], drawn: _Draws) -> Any:
            env, noise, member = carry
            own = self.env.lane_params(params, member)
            observed = jnp.stack(self.env.observe(env, noise, own), axis=1)
            head = outputs(actor, self.algorithm.activation, observed)[:, 0]
            action = self._sample(head, learner.stack.log_std, drawn.actions)
            log_prob, _ = log_prob_and_entropy(head, learner.stack.log_std, action)
            after, outcome = self.env.advance(env, self._control(action, own), own)
            ended = outcome.terminated | outcome.truncated
            fresh = tuple(jnp.moveaxis(drawn.noise, 1, 0))
            begun = self.env.fresh(tuple(jnp.moveaxis(drawn.starts, 1, 0)), params)
            next_env, next_member = jax.tree.map(
                lambda a, b: jnp.where(ended, a, b), begun, (after, member)
            )
            half = self._noise_size
            next_noise = _where(outcome.sampled, fresh[:half], noise)
            next_noise = _where(ended, fresh[half:], next_noise)
            kept = _Step(
                env,
                noise,
                member,
                action,
                log_prob,
                outcome.terminated,
                outcome.truncated,
                drawn.noise,
            )
            return (next_env, next_noise, next_member), kept

        return jax.lax.scan(step, (learner.env, learner.noise, learner.member), draws)

    def _sample(self, head: Array, log_std: Array, drawn: Array) -> Array:
        if self.discrete:
            return jnp.argmax(head + drawn, axis=1, keepdims=True).astype(jnp.float32)
        return head + jnp.exp(log_std)[..., None] * drawn

    def _control(self, action: Array, own: Any) -> Array:
        """Clipped to the action space, as the environment gets it, (…, policies, n_envs)."""
        control = action[..., 0, :]
        if self.discrete:
            return control
        limit = self.env.setup_of(own).task.control_limit
        return jnp.clip(control, -limit, limit)

    def _again(self, steps: _Step, params: Params) -> tuple[EnvState, Outcome, Array, Array]:
        """All transitions of the rollout at once, and the observations before and after them.

        The scan keeps states and actions only; this gives everything that follows from them.
        """
        own = self.env.lane_params(params, steps.member)
        control = self._control(steps.action, own)
        after, outcome = self.env.advance(steps.env, control, own)
        outcome = outcome._replace(terminated=steps.terminated, truncated=steps.truncated)
        fresh = tuple(jnp.moveaxis(steps.fresh, 2, 0))[: self._noise_size]
        noise = _where(outcome.sampled, fresh, steps.noise)
        before = jnp.stack(self.env.observe(steps.env, steps.noise, own))
        return after, outcome, before, jnp.stack(self.env.observe(after, noise, own))

    def _batch(
        self,
        stack: Stack,
        knobs: Knobs,
        steps: _Step,
        outcome: Outcome,
        observed: tuple[Array, Array],
    ) -> Batch:
        """Advantages and returns; an episode cut off by the time limit is bootstrapped."""
        before, after = (_flat(x) for x in observed)
        critic = one_side(stack, 1)
        shape = outcome.reward.shape

        def value_of(critic: Stack, observations: Array) -> Array:
            return outputs(critic, self.algorithm.activation, observations)[:, 0, 0]

        def value(observations: Array) -> Array:
            values = self._each(value_of, (critic, observations))
            return jnp.moveaxis(values.reshape(shape[1], shape[2], shape[0]), -1, 0)

        values, next_values = value(before), value(after)
        reward = outcome.reward.astype(jnp.float32) * knobs.reward_scale[:, None]
        advantages = advantages_of(reward, values, next_values, steps, knobs)
        return Batch(
            before,
            _flat(jnp.moveaxis(steps.action, 2, 0)),
            _flat(steps.log_prob[None])[:, 0],
            _flat(advantages[None])[:, 0],
            _flat((advantages + values)[None])[:, 0],
        )

    def _permutations(self, keys: Array) -> Array:
        """Orders of the rollout's decisions, int32 (n_epochs, policies, rollout)."""
        size = self.algorithm.rollout
        bits = _draw(jax.random.bits, keys, (self.algorithm.n_epochs, size))
        if size <= 1 << _INDEX_BITS:
            mask = jnp.uint32((1 << max(1, (size - 1).bit_length())) - 1)
            packed = (bits & ~mask) | jnp.arange(size, dtype=jnp.uint32)
            order = jnp.sort(packed, axis=-1) & mask
        else:
            order = jnp.argsort(bits, axis=-1)
        return jnp.moveaxis(order.astype(jnp.int32), 1, 0)

    def update(
        self,
        stack: Stack,
        adam: Adam,
        batch: Batch,
        permutations: Array,
        knobs: Knobs,
        learning_rate: Array,
    ) -> tuple[Stack, Adam]:
        """Learn from one rollout.

        Args:
            stack: weights.
            adam: state of the optimizer.
            batch: the rollout.
            permutations: int32 (epochs, policies, n): the order of the decisions in each epoch.
            knobs: hyperparameters.
            learning_rate: (policies,).
        """
        packed = jnp.concatenate(
            [batch.observations, batch.actions, *(x[:, None] for x in batch[2:])], axis=1
        )
        rows = jnp.swapaxes(packed, 1, 2)
        sizes = batch.observations.shape[1], batch.actions.shape[1]
        policies, total, width = rows.shape
        batch_size = self.algorithm.batch_size

        def learn(carry: Any, part: Array) -> Any:
            stack, adam, active = carry
            minibatch = _unpacked(part, sizes)
            gradient, divergence = self._gradient(stack, minibatch, knobs)
            if not self.algorithm.stops_early:
                return (*_adam_step(stack, adam, gradient, knobs, learning_rate), active), None
            active = active & (divergence <= 1.5 * knobs.target_kl)
            learned = _adam_step(stack, adam, gradient, knobs, learning_rate)
            kept = jax.tree.map(
                lambda new, old: jnp.where(_over(active, new), new, old), learned, (stack, adam)
            )
            return (*kept, active), None

        def epoch(carry: Any, order: Array) -> Any:
            shuffled = jnp.take_along_axis(rows, order[..., None], axis=1)
            parts = shuffled.reshape(policies, total // batch_size, batch_size, width)
            carry, _ = jax.lax.scan(learn, carry, parts.transpose(1, 0, 3, 2))
            return carry, None

        start = (stack, adam, jnp.ones(policies, bool))
        (stack, adam, _), _ = jax.lax.scan(epoch, start, permutations)
        return stack, adam

    def _gradient(self, stack: Stack, batch: Batch, knobs: Knobs) -> tuple[Stack, Array]:
        """Gradient of every policy's loss, and its approximate divergence from the rollout's."""
        advantages = batch.advantages
        if self.algorithm.normalize_advantage and advantages.shape[1] > 1:
            mean = advantages.mean(1, keepdims=True)
            spread = jnp.std(advantages, axis=1, keepdims=True, ddof=1)
            advantages = (advantages - mean) / (spread + _ADVANTAGE_EPSILON)
        clip = knobs.clip_range[:, None]

        def loss(stack: Stack) -> tuple[Array, Array]:
            out = outputs(stack, self.algorithm.activation, batch.observations)
            log_prob, entropy = log_prob_and_entropy(out[:, 0], stack.log_std, batch.actions)
            log_ratio = log_prob - batch.log_probs
            ratio = jnp.exp(log_ratio)
            clipped = jnp.clip(ratio, 1.0 - clip, 1.0 + clip)
            surrogate = jnp.minimum(advantages * ratio, advantages * clipped).mean(1)
            error = batch.returns - out[:, 1, 0]
            losses = (
                -surrogate
                - knobs.ent_coef * entropy.mean(1)
                + knobs.vf_coef * (error * error).mean(1)
            )
            return losses.sum(), ((ratio - 1.0) - log_ratio).mean(1)

        gradient, divergence = jax.grad(loss, has_aux=True)(stack)
        return gradient, divergence

    def _trail(
        self,
        steps: _Step,
        after: EnvState,
        outcome: Outcome,
        before_observed: Array,
        after_observed: Array,
        params: Params,
    ) -> Trail:
        setup = self.env.setup_of(self.env.lane_params(params, steps.member))
        rows: dict[str, Array] = {
            **booked(setup, after, outcome),
            "solver_status_code": outcome.status,
            "reward": outcome.reward,
            "terminated": outcome.terminated,
            "truncated": outcome.truncated,
            **self._named(after, after_observed),
        }
        first: dict[str, Array] = {
            "energy": steps.env.energy,
            "goal_since": steps.env.goal_since,
            **self._named(steps.env, before_observed),
        }
        return Trail(
            outcome.reward,
            outcome.terminated | outcome.truncated,
            outcome.success,
            steps.env.steps == 0,
            steps.member[0] if steps.member else jnp.zeros_like(steps.env.steps),
            _stacked(rows, self.entries),
            _stacked(first, self.first_entries),
        )

    def _named(self, env: EnvState, observed: Array) -> dict[str, Array]:
        """True state and observation, by the names that evidence gives them."""
        setup = self.env.setup
        states = zip(state_names(setup.plant), join_state(env.q, env.v), strict=True)
        sensed = (f"sensed_{name}" for name in setup.task.observation_names)
        return {**dict(states), **dict(zip(sensed, observed, strict=True))}


def advantages_of(
    reward: Array, values: Array, next_values: Array, steps: _Step, knobs: Knobs
) -> Array:
    """Generalized advantage estimates, (n_steps, policies, n_envs).

    ``next_values`` are the critic's at the state after each step, before a reset. Nothing is
    bootstrapped where an episode was terminated, and nothing passes an episode's end.
    Source: Schulman et al. (2016), *High-dimensional continuous control using generalized
    advantage estimation*, arXiv:1506.02438.
    """
    gamma, decay = knobs.gamma[:, None], (knobs.gamma * knobs.gae_lambda)[:, None]
    goes_on = jnp.where(steps.terminated | steps.truncated, 0.0, 1.0)
    bootstrapped = jnp.where(steps.terminated, 0.0, next_values)
    delta = reward + gamma * bootstrapped - values

    def back(later: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        advantage = now[0] + decay * now[1] * later
        return advantage, advantage

    _, advantages = jax.lax.scan(
        back, jnp.zeros_like(delta[0]), (delta, goes_on), reverse=True, unroll=8
    )
    return advantages


def _adam_step(
    stack: Stack, adam: Adam, gradient: Stack, knobs: Knobs, learning_rate: Array
) -> tuple[Stack, Adam]:
    """One step of Adam along the gradient, scaled down to the largest norm.

    Source: Kingma and Ba (2015), *Adam: a method for stochastic optimization*, arXiv:1412.6980.
    """
    squares = [(g * g).reshape(g.shape[0], -1).sum(1) for g in jax.tree.leaves(gradient)]
    norm = jnp.sqrt(sum(squares[1:], squares[0]))
    scale = jnp.minimum(1.0, knobs.max_grad_norm / (norm + _NORM_EPSILON))
    gradient = jax.tree.map(lambda g: g * _over(scale, g), gradient)
    count = adam.count + 1.0
    first, second = ADAM_DECAY
    size = learning_rate / (1.0 - first**count)
    root = 1.0 / jnp.sqrt(1.0 - second**count)
    mean = jax.tree.map(lambda m, g: first * m + (1.0 - first) * g, adam.mean, gradient)
    square = jax.tree.map(lambda s, g: second * s + (1.0 - second) * g * g, adam.square, gradient)
    stack = jax.tree.map(
        lambda p, m, s: p - _over(size, p) * m / (jnp.sqrt(s) * _over(root, p) + ADAM_EPSILON),
        stack, mean, square,
    )  # fmt: skip
    return stack, Adam(mean, square, count)


def _unpacked(part: Array, sizes: tuple[int, int]) -> Batch:
    observations, actions = sizes
    rest = observations + actions
    return Batch(
        part[:, :observations],
        part[:, observations:rest],
        part[:, rest],
        part[:, rest + 1],
        part[:, rest + 2],
    )


def _flat(values: Array) -> Array:
    """(k, n_steps, policies, n_envs) to (policies, k, n_envs · n_steps), as SB3 orders them."""
    k, steps, policies, lanes = values.shape
    return values.transpose(2, 0, 3, 1).reshape(policies, k, lanes * steps)


def _where(condition: Array, new: Components, old: Components) -> Components:
    return tuple(jnp.where(condition, a, b) for a, b in zip(new, old, strict=True))


def _over(per_policy: Array, like: Array) -> Array:
    """Shape (policies,) as one that broadcasts against ``like``."""
    return per_policy.reshape(per_policy.shape + (1,) * (like.ndim - 1))


def _split(keys: Array, count: int) -> tuple[Array, ...]:
    """``count`` new keys for every policy."""
    return tuple(jnp.moveaxis(jax.vmap(lambda key: jax.random.split(key, count))(keys), 1, 0))


def _draw(sample: Callable[..., Array], keys: Array, shape: tuple[int, ...]) -> Array:
    """Random numbers of shape (policies, *shape), each policy's from its own key."""
    return jax.vmap(lambda key: sample(key, shape))(keys)


def _stacked(columns: dict[str, Array], names: tuple[str, ...]) -> Array:
    if not names:
        return jnp.zeros((0,))
    return jnp.stack([columns[name].astype(jnp.float32) for name in names])
