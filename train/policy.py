"""Policies: what acts, and the multilayer perceptron that trainers and files share."""

from __future__ import annotations

import hashlib
import inspect
import json
import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from integ_gym.support.errors import InputError, InputTypeError

Array: TypeAlias = NDArray[Any]
FloatArray: TypeAlias = NDArray[np.float32]
ActionArray: TypeAlias = NDArray[np.float32] | NDArray[np.int64]


def freeze_array(values: ArrayLike, dtype: type[np.generic]) -> NDArray[Any]:
    """A read-only contiguous copy of `values` as `dtype`."""
    array = np.array(values, dtype=dtype, order="C", copy=True)
    array.flags.writeable = False
    return array


@runtime_checkable
class Policy(Protocol):
    """What acts in an evaluation: the mean (or argmax) action, never a sampled one."""

    @property
    def policy_id(self) -> str:
        """Name that people read in tables."""

    @property
    def content_hash(self) -> str:
        """Hex digest of everything that decides the actions, the same in every process."""

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Actions for a batch of observations.

        Args:
            observations: shape (n, obs_dim), in the environment's units.

        Returns:
            float32 of shape (n, action_dim) within the bounds for a `Box` action space, in the
            environment's units; int64 of shape (n,) for a `Discrete` one.
        """


def start_acting(policy: Policy) -> Callable[[Array], Array]:
    """What acts, as `Policy.act` does, in episodes that begin now.

    A policy that remembers has a method ``begin``: the observations of one call after the other
    are those of the same lanes, each of which has a memory of its own.
    """
    begin: Callable[[], Callable[[Array], Array]] | None = getattr(policy, "begin", None)
    return policy.act if begin is None else begin()


def expand_bound(bound: ArrayLike, size: int) -> FloatArray:
    """A bound as float32 of shape (size,), from one number for all actions or one for each."""
    flat: FloatArray = np.asarray(bound, dtype=np.float32).ravel()
    return np.repeat(flat, size) if flat.size == 1 else flat


@dataclass(frozen=True, eq=False)
class BoxActions:
    """Network outputs as the actions of a one-dimensional `Box`.

    Attributes:
        low: float32, shape (action_dim,), lower bounds in the action's units, finite.
        high: float32, shape (action_dim,), upper bounds, finite.
        squash: False clips the outputs to the bounds; True passes them through tanh and stretches
            (−1, 1) to the bounds, as SB3 does with `squash_output=True`.
        limit: size that outputs are limited to before tanh, as SAC's with gSDE are.

    Raises:
        ValueError: on shapes that differ, bounds that are not finite, or `low` above `high`; or
            for a limit that is not above 0, or without tanh.
    """

    low: FloatArray
    high: FloatArray
    squash: bool = False
    limit: float = math.inf

    def __post_init__(self) -> None:
        """Copy the bounds and check them."""
        object.__setattr__(self, "low", freeze_array(self.low, np.float32))
        object.__setattr__(self, "high", freeze_array(self.high, np.float32))
        if self.low.ndim != 1 or self.low.shape != self.high.shape:
            raise InputError(
                "the bounds 'low' and 'high' must be one-dimensional and of one shape, got "
                f"{self.low.shape} and {self.high.shape}"
            )
        if not self.limit > 0 or (self.limit < math.inf and not self.squash):
            raise InputError(
                f"a limit of outputs must be above 0 and comes before tanh, got {self.limit} with "
                f"squash={self.squash}"
            )
        finite = np.isfinite(self.low) & np.isfinite(self.high)
        if not (finite & (self.low <= self.high)).all():
            raise InputError(
                f"the action bounds must be finite and 'low' not above 'high', got {self}; "
                "give the bounds of the environment's action space"
            )

    @property
    def size(self) -> int:
        """Number of network outputs this needs."""
        return len(self.low)

    @property
    def space(self) -> spaces.Box:
        """The action space whose members are produced."""
        return spaces.Box(self.low, self.high, dtype=np.float32)

    def decode(self, outputs: FloatArray) -> FloatArray:
        """Actions, float32 of shape (n, action_dim), for network outputs of the same shape."""
        if not self.squash:
            return np.clip(outputs, self.low, self.high)
        if self.limit < math.inf:
            outputs = np.clip(outputs, -self.limit, self.limit)
        return self.low + (0.5 * (np.tanh(outputs) + 1.0) * (self.high - self.low))

    def __str__(self) -> str:
        """Kind and bounds, in one line."""
        return f"Box({self.low.tolist()}, {self.high.tolist()})"


@dataclass(frozen=True)
class DiscreteActions:
    """Network outputs as the choice among `Discrete(n)`.

    Attributes:
        n: number of actions, at least 1.

    Raises:
        ValueError: if `n` is below 1.
    """

    n: int

    def __post_init__(self) -> None:
        """Check the number of actions."""
        if self.n < 1:
            raise InputError(f"a Discrete action space needs at least one action, got {self.n}")

    @property
    def size(self) -> int:
        """Number of network outputs this needs."""
        return self.n

    @property
    def space(self) -> spaces.Discrete:
        """The action space whose members are produced."""
        return spaces.Discrete(self.n)

    def decode(self, outputs: FloatArray) -> NDArray[np.int64]:
        """The first largest output of each row: int64, shape (n,), from shape (n, actions).

        Raises:
            ValueError: if an output is NaN, because no choice can be made.
        """
        if np.isnan(outputs).any():
            raise InputError(
                "the policy network gives NaN, so no discrete action can be chosen; "
                "give it finite observations of ordinary size"
            )
        choice: NDArray[np.int64] = outputs.argmax(axis=1).astype(np.int64)
        return choice

    def __str__(self) -> str:
        """Kind and size."""
        return f"Discrete({self.n})"


Layer: TypeAlias = tuple[FloatArray, FloatArray]


def _sigmoid(x: FloatArray) -> FloatArray:
    decay: FloatArray = np.exp(-np.abs(x))
    numerator: FloatArray = np.where(x >= 0, np.float32(1.0), decay)
    return numerator / (1.0 + decay)


def _selu(x: FloatArray) -> FloatArray:
    alpha, scale = 1.6732632423543772, 1.0507009873554805
    unscaled: FloatArray = np.where(x > 0, x, alpha * np.expm1(np.minimum(x, 0.0)))
    return scale * unscaled


def _softplus(x: FloatArray) -> FloatArray:
    return np.logaddexp(np.float32(0.0), x)


def _softsign(x: FloatArray) -> FloatArray:
    size: FloatArray = np.abs(x)
    return x / (1.0 + size)


def _gelu(x: FloatArray) -> FloatArray:
    erf = np.vectorize(math.erf, otypes=[np.float32])
    half_cdf: FloatArray = 0.5 * (1.0 + erf(x * math.sqrt(0.5)))
    return x * half_cdf


#: Activations by the name of their torch class, each with that class's default parameters.
ACTIVATIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "Tanh": np.tanh,
    "ReLU": lambda x: np.maximum(x, 0.0),
    "ReLU6": lambda x: np.clip(x, 0.0, 6.0),
    "LeakyReLU": lambda x: np.where(x > 0, x, 0.01 * x),
    "ELU": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0.0))),
    "SELU": _selu,
    "SiLU": lambda x: x * _sigmoid(x),
    "GELU": _gelu,
    "Mish": lambda x: x * np.tanh(_softplus(x)),
    "Sigmoid": _sigmoid,
    "Softplus": _softplus,
    "Softsign": _softsign,
}


def network_outputs(
    layers: Sequence[Layer], activate: Callable[[FloatArray], FloatArray], features: FloatArray
) -> FloatArray:
    """Outputs of a feed-forward network, or of a stack of them.

    Args:
        layers: (weight, bias) of each layer, of shapes (…, out, in) and (…, 1, out); the bias of
            a single network may have shape (out,).
        activate: follows every layer but the last.
        features: shape (…, n, inputs).

    Returns:
        Shape (…, n, outputs).
    """
    for weight, bias in layers[:-1]:
        features = activate(features @ weight.swapaxes(-1, -2) + bias)
    weight, bias = layers[-1]
    return features @ weight.swapaxes(-1, -2) + bias


@dataclass(frozen=True, eq=False)
class ObservationStatistics:
    """Observation scaling as SB3's `VecNormalize` applies it at evaluation.

    normalized = clip((observation − mean) / sqrt(var + epsilon), −clip_obs, clip_obs)

    Attributes:
        mean: float64, shape (obs_dim,), in the observation's units.
        var: float64, shape (obs_dim,), those units squared, not negative.
        epsilon: added to `var`, > 0.
        clip_obs: bound on the normalized value, > 0, no unit.

    Raises:
        ValueError: on shapes that differ, on values that are not finite or have the wrong sign.
    """

    mean: NDArray[np.float64]
    var: NDArray[np.float64]
    epsilon: float
    clip_obs: float

    def __post_init__(self) -> None:
        """Copy the arrays and check everything."""
        object.__setattr__(self, "mean", freeze_array(self.mean, np.float64))
        object.__setattr__(self, "var", freeze_array(self.var, np.float64))
        if self.mean.ndim != 1 or self.mean.shape != self.var.shape:
            raise InputError(
                "'mean' and 'var' must be two lists of numbers of one length, got shapes "
                f"{self.mean.shape} and {self.var.shape}"
            )
        if not (np.isfinite(self.mean).all() and np.isfinite(self.var).all()):
            raise InputError("'mean' and 'var' must hold finite numbers only")
        if (self.var < 0).any():
            raise InputError(f"'var' must hold no negative number, got {self.var.min()}")
        for name, value in (("epsilon", self.epsilon), ("clip_obs", self.clip_obs)):
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"'{name}' must be a finite number above 0, got {value}")

    def normalize(self, observations: NDArray[Any]) -> FloatArray:
        """Normalized observations.

        Args:
            observations: shape (n, obs_dim), in the environment's units.

        Returns:
            float32, shape (n, obs_dim), no unit.
        """
        scaled = (observations - self.mean) / np.sqrt(self.var + self.epsilon)
        return np.clip(scaled, -self.clip_obs, self.clip_obs).astype(np.float32)


_MOST = float(np.finfo(np.float32).max)
"""Bound of actions that have none."""

_HASH_FORMAT = "integ-gym MlpPolicy 1"


@dataclass(frozen=True, eq=False)
class MlpPolicy:
    """A feed-forward actor that acts as SB3's `PPO.predict(obs, deterministic=True)` does.

    All arithmetic is float32, as in torch; only the observation statistics are float64, as in
    `VecNormalize`. Actions agree with SB3's to about 1e-6 of the action's size, not bit by bit,
    because the two libraries add up a matrix product in different orders.

    Attributes:
        layers: (weight, bias) of each layer, input first; weight float32 of shape (out, in), bias
            float32 of shape (out,). The activation follows every layer but the last.
        activation: a key of `ACTIVATIONS`, the name of the torch class, for example "Tanh".
        actions: how the outputs become actions, `BoxActions` or `DiscreteActions`.
        statistics: applied to observations before the first layer, or None.
        policy_id: name that people read in tables; it is not part of `content_hash`.

    Raises:
        ValueError: if the shapes do not chain, a weight is not finite, or the activation is not
            known.
    """

    layers: tuple[Layer, ...]
    activation: str
    actions: BoxActions | DiscreteActions
    statistics: ObservationStatistics | None = None
    policy_id: str = "mlp"

    def __post_init__(self) -> None:
        """Copy the weights and check that everything fits together."""
        layers = tuple(
            (freeze_array(w, np.float32), freeze_array(b, np.float32)) for w, b in self.layers
        )
        object.__setattr__(self, "layers", layers)
        if self.activation not in ACTIVATIONS:
            raise InputError(
                f"the activation {self.activation!r} is not known; "
                f"use one of {', '.join(sorted(ACTIVATIONS))}"
            )
        self._check_layers()
        if self.statistics is not None and self.statistics.mean.shape != self.observation_shape:
            raise InputError(
                f"the observation statistics have shape {self.statistics.mean.shape} and the "
                f"policy takes observations of shape {self.observation_shape}; "
                "use the statistics saved with this policy"
            )

    def _check_layers(self) -> None:
        """Raise ValueError unless the layers chain up to the number of outputs and are finite."""
        if not self.layers:
            raise InputError("a policy needs at least one layer, got none")
        for index, (weight, bias) in enumerate(self.layers):
            before = self.layers[index - 1][0].shape[0] if index else weight.shape[-1]
            if weight.ndim != 2 or weight.shape != (*bias.shape, before):
                raise InputError(
                    f"layer {index} has a weight of shape {weight.shape} and a bias of shape "
                    f"{bias.shape} after {before} inputs; expected (out, {before}) and (out,)"
                )
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise InputError(
                    f"layer {index} has weights that are not finite, so training diverged; "
                    "train again with a lower learning rate"
                )
        if len(self.layers[-1][1]) != self.actions.size:
            raise InputError(
                f"the last layer has {len(self.layers[-1][1])} outputs and the action space "
                f"{self.actions} needs {self.actions.size}"
            )

    @property
    def observation_shape(self) -> tuple[int, ...]:
        """Shape of one observation, (obs_dim,)."""
        return (self.layers[0][0].shape[1],)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 (hex) over architecture, activation, action mapping, weights and statistics.

        It is the same on every machine and in every process; `policy_id` has no part in it. A JSON
        header that fixes every array's shape comes before the arrays.
        """
        header: dict[str, Any] = {
            "format": _HASH_FORMAT,
            "activation": self.activation,
            "layers": [weight.shape for weight, _ in self.layers],
            "discrete": isinstance(self.actions, DiscreteActions),
        }
        arrays: list[NDArray[Any]] = [array for layer in self.layers for array in layer]
        if isinstance(self.actions, BoxActions):
            header["squash"] = bool(self.actions.squash)
            if self.actions.limit < math.inf:
                header["limit"] = float(self.actions.limit).hex()
            arrays += [self.actions.low, self.actions.high]
        if self.statistics is not None:
            limits = (self.statistics.epsilon, self.statistics.clip_obs)
            header["statistics"] = [float(limit).hex() for limit in limits]
            arrays += [self.statistics.mean, self.statistics.var]
        digest = hashlib.sha256(json.dumps(header, sort_keys=True).encode() + b"\n")
        for array in arrays:
            digest.update(array.astype(array.dtype.newbyteorder("<")).tobytes())
        return digest.hexdigest()

    def outputs(self, observations: NDArray[Any]) -> FloatArray:
        """What the last layer gives, before it becomes an action.

        Args:
            observations: shape (n, obs_dim), in the environment's units; of another shape with as
                many numbers they are flattened.

        Returns:
            float32, shape (n, action_dim): means before clipping or squashing for a `Box` action
            space, logits for a `Discrete` one.

        Raises:
            ValueError: on another shape.
        """
        observations = np.asarray(observations)
        if observations.ndim < 2 or math.prod(observations.shape[1:]) != self.observation_shape[0]:
            raise InputError(
                f"expected observations of shape (n, {self.observation_shape[0]}), got "
                f"{observations.shape}; pass a batch, for example observation[None]"
            )
        activate = ACTIVATIONS[self.activation]
        observations = observations.reshape(len(observations), self.observation_shape[0])
        with np.errstate(over="ignore", invalid="ignore"):
            if self.statistics is None:
                features: FloatArray = observations.astype(np.float32)
            else:
                features = self.statistics.normalize(observations)
            return network_outputs(self.layers, activate, features)

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Deterministic actions for a batch of observations.

        Args:
            observations: shape (n, obs_dim), in the environment's units.

        Returns:
            float32 of shape (n, action_dim), saturated to the bounds, for `BoxActions`; int64 of
            shape (n,) for `DiscreteActions`. A `Box` action is NaN where the observation is, so
            that the environment's fallback takes over; see `DiscreteActions.decode`.

        Raises:
            ValueError: on another shape, or where a discrete choice is impossible.
        """
        return self.actions.decode(self.outputs(observations))

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray] | None:
        """Lower and upper bounds of its actions, in their units; None where it has none."""
        actions = self.actions
        if (
            isinstance(actions, DiscreteActions)
            or np.abs([actions.low, actions.high]).min() >= _MOST
        ):
            return None
        return actions.low, actions.high

    def check_spaces(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
    ) -> None:
        """Check that the policy can act in an environment with these (single) spaces.

        Only kinds and sizes count: a policy keeps its own bounds in an environment that was
        perturbed, and a space of shape (1, n) is one of n numbers.

        Raises:
            ValueError: in one sentence, with what the policy expects, what was found, the remedy.
        """
        remedy = "evaluate it in the kind of environment it was trained in, or train one here"
        if (
            not isinstance(observation_space, spaces.Box)
            or math.prod(observation_space.shape) != self.observation_shape[0]
        ):
            raise InputError(
                f"policy {self.policy_id!r} expects observations of shape "
                f"{self.observation_shape} and the environment gives "
                f"{_describe(observation_space)}; {remedy}"
            )
        expected = self.actions.space
        if isinstance(expected, spaces.Discrete):
            fits = isinstance(action_space, spaces.Discrete) and (
                (action_space.n, action_space.start) == (expected.n, 0)
            )
        else:
            fits = (
                isinstance(action_space, spaces.Box)
                and math.prod(action_space.shape) == self.actions.size
            )
        if not fits:
            raise InputError(
                f"policy {self.policy_id!r} gives actions for {_describe(expected)} and the "
                f"environment takes {_describe(action_space)}; {remedy}"
            )


def _describe(space: spaces.Space[Any]) -> str:
    """A space in a few words: `Box of shape (3,)`, `Discrete(2)`, else the space's own text."""
    if isinstance(space, spaces.Box):
        return f"Box of shape {space.shape}"
    return str(space)


class PolicyStack:
    """Policies that act together in episodes that begin now.

    Networks of one shape act as one product of stacked matrices.

    A policy's actions are those of its own `act` on its own observations, to the last bit,
    whichever policies are beside it.

    Args:
        policies: at least one, all for the same kind of actions.
        batched: whether all of a policy's observations are given to it together, which may show in
            the last bits of its actions; else they are given one by one to a policy that does not
            say by ``any_batch`` that this changes nothing.

    Attributes:
        count: of policies.
        batched: as given.
    """

    def __init__(self, policies: Sequence[Policy], batched: bool = True) -> None:
        self.count, self.batched = len(policies), batched
        self._parts = [_part(policies, places) for places in _alike(policies)]
        self._together = [
            batched or all(getattr(policies[place], "any_batch", False) for place in places)
            for places, _ in self._parts
        ]
        self._begun: dict[tuple[int, int], Callable[[Array], Array]] = {}

    def act(self, observations: Array, asked: Array | None = None) -> NDArray[np.float64]:
        """Actions of every policy.

        Args:
            observations: shape (policies, n, obs_dim), in the environment's units.
            asked: which ones are to be acted on, shape (policies, n), some at least; None: all.
                Where ``batched``, a policy that remembers is asked about all or none.

        Returns:
            Shape (policies, n, action_dim) for a `Box` action space, (policies, n) for a
            `Discrete` one; zeros where nothing was asked.

        Raises:
            ValueError: as `Policy.act` does.
        """
        lanes, taken = np.arange(observations.shape[1]), []
        for part, (places, _) in enumerate(self._parts):
            own = lanes if asked is None else np.flatnonzero(asked[places].any(axis=0))
            groups = [own] if self._together[part] else [*own[:, None]]
            for group in groups if own.size else ():
                where = np.ix_(np.array(places), group)
                first = 0 if self._together[part] else int(group[0])
                taken.append((where, self._acting(part, first)(observations[where])))
        actions = np.zeros((*observations.shape[:2], *taken[0][1].shape[2:]))
        for where, values in taken:
            actions[where] = values
        if asked is not None:
            actions[~asked] = 0.0
        return actions

    def _acting(self, part: int, lane: int) -> Callable[[Array], Array]:
        """What has begun to act with a lane, or with all, for a part."""
        if (part, lane) not in self._begun:
            self._begun[part, lane] = self._parts[part][1]()
        return self._begun[part, lane]


def _alike(policies: Sequence[Policy]) -> Iterable[list[int]]:
    """Places of the policies that make one part."""
    groups: dict[Hashable, list[int]] = {}
    for place, policy in enumerate(policies):
        groups.setdefault(_form(policy) or place, []).append(place)
    return groups.values()


def _form(policy: Policy) -> Hashable:
    """What networks that are stacked have in common; None for what is not stacked."""
    if not isinstance(policy, MlpPolicy) or policy.statistics is not None:
        return None
    shapes = tuple(weight.shape for weight, _ in policy.layers)
    actions = policy.actions
    if isinstance(actions, BoxActions):
        bounds = (actions.low.tobytes(), actions.high.tobytes(), actions.squash, actions.limit)
        return shapes, policy.activation, bounds
    return shapes, policy.activation, actions


def _part(
    policies: Sequence[Policy], places: list[int]
) -> tuple[list[int], Callable[[], Callable[[Array], Array]]]:
    """Places of policies, and what begins to act for them."""
    chosen = [policies[place] for place in places]
    if len(chosen) > 1:
        together = _together(chosen)  # type: ignore[arg-type]
        return places, lambda: together

    def begin() -> Callable[[Array], Array]:
        act = start_acting(chosen[0])
        return lambda observations: act(observations[0])[None]

    return places, begin


def _together(policies: Sequence[MlpPolicy]) -> Callable[[Array], Array]:
    """`PolicyStack.act` of networks of one form."""
    first = policies[0]
    decode: Callable[[FloatArray], ActionArray] = first.actions.decode
    layers = [
        (np.stack([weight for weight, _ in layer]), np.stack([bias for _, bias in layer])[:, None])
        for layer in zip(*(policy.layers for policy in policies), strict=True)
    ]

    def act(observations: Array) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):
            features = observations.astype(np.float32)
            outputs = network_outputs(layers, ACTIVATIONS[first.activation], features)
        actions = decode(outputs.reshape(-1, outputs.shape[-1]))
        return actions.reshape(*outputs.shape[:2], *actions.shape[1:])

    return act


Way = Literal["act", "predict", "call"]


@dataclass(frozen=True, eq=False)
class CalledPolicy:
    """A policy in another library's code, asked as its author asks it.

    With ``act`` or ``predict``, as of stable-baselines3, it is given a batch of observations, and
    ``deterministic=True`` where ``predict`` takes that; anything else that is callable is given one
    observation at a time, so that its actions do not depend on how many are asked for. What takes a
    ``state`` besides remembers: it gives an action and its next state, and is given None for the
    first one of an episode, one observation at a time but by ``predict``.

    Attributes:
        target: the object.
        action_space: one-dimensional `Box`, or `Discrete` from 0.
        policy_id: name that people read in tables.
        content_hash: of its actions; see :func:`behaviour_hash`.

    Raises:
        TypeError: for what cannot be asked for actions.
    """

    target: Any
    action_space: spaces.Space[Any]
    policy_id: str
    content_hash: str = ""

    def __post_init__(self) -> None:
        """Check that there is a way to ask."""
        self._way()

    def _way(self) -> Way:
        if hasattr(self.target, "act"):
            return "act"
        if getattr(self.target, "predict", None) is not None:
            return "predict"
        if not callable(self.target):
            raise InputTypeError(
                f"a policy must be callable or have `predict`, got {type(self.target).__name__}; "
                "give a function from one observation to one action"
            )
        return "call"

    def begin(self) -> Callable[[NDArray[Any]], ActionArray]:
        """See :func:`start_acting`."""
        states: list[Any] = []
        return lambda observations: self._act(observations, states)

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Actions for a batch of observations, with which episodes begin.

        Args:
            observations: shape (n, obs_dim), in the environment's units.

        Returns:
            float32 of shape (n, action_dim), beyond the bounds where the policy goes beyond them;
            int64 of shape (n,) for a `Discrete` action space.

        Raises:
            ValueError: if it fails, or what comes back are no such actions.
        """
        return self._act(observations, [])

    def _act(self, observations: NDArray[Any], states: list[Any]) -> ActionArray:
        try:
            given = self._ask(observations, states)
        except Exception as error:
            raise InputError(
                f"policy {self.policy_id!r} raised {type(error).__name__}: {error}; give a "
                f"function from one observation, an array of shape {observations.shape[1:]}, to "
                "one action"
            ) from error
        return self._as_actions(given, len(observations))

    def _ask(self, observations: NDArray[Any], states: list[Any]) -> NDArray[Any]:
        """Actions; ``states`` is what it remembers, empty at first, and is changed."""
        way = self._way()
        if way == "predict":
            predict = self.target.predict
            known = {"deterministic": True} if _takes(predict, "deterministic") else {}
            given = predict(observations, **known, **({"state": states[0]} if states else {}))
            if not isinstance(given, tuple):
                return _array(given)
            remembers = _takes(predict, "state") and given[1:] and given[1] is not None
            states[:] = [given[1]] if remembers else []
            return _array(given[0])
        ask = self.target.act if way == "act" else self.target
        if not _takes(ask, "state"):
            together = way == "act"
            return _array(ask(observations)) if together else _stack(map(ask, observations))
        states.extend([None] * (len(observations) - len(states)))
        actions, states[:] = zip(*map(ask, observations, states), strict=True)
        return _stack(actions)

    def _as_actions(self, given: NDArray[Any], count: int) -> ActionArray:
        discrete = isinstance(self.action_space, spaces.Discrete)
        size = 1 if discrete else int(np.prod(self.action_space.shape or ()))
        if given.size != count * size or given.dtype.kind not in "biuf":
            shape = "" if discrete else f" of shape {self.action_space.shape}"
            raise InputError(
                f"policy {self.policy_id!r} gave an array of shape {given.shape} and type "
                f"{given.dtype} for {count} observations, where {count} actions of "
                f"{self.action_space} were expected; give one action{shape} for one observation"
            )
        if not discrete:
            return given.reshape(count, size).astype(np.float32)
        whole = given.reshape(count)
        if not np.array_equal(whole, np.floor(whole)):
            raise InputError(
                f"policy {self.policy_id!r} gave {whole[0]!r} where a whole number was expected; "
                f"give the number of an action of {self.action_space}"
            )
        return whole.astype(np.int64)


def behaviour_hash(policy: CalledPolicy, observations: NDArray[Any]) -> str:
    """SHA-256 (hex) of what a policy does: its actions for given observations.

    Code has no content that could be hashed and decides everything; what it does tells two
    policies apart, though not two that differ elsewhere alone.

    Args:
        policy: what acts.
        observations: shape (n, obs_dim), in the environment's units.

    Raises:
        ValueError: if it gives other actions when asked again.
    """
    runs = [[act(observations) for _ in range(2)] for act in (policy.begin(), policy.begin())]
    if not np.array_equal(runs[0], runs[1], equal_nan=True):
        raise InputError(
            f"policy {policy.policy_id!r} gives other actions when it is asked again about the "
            "same observations; judge one that takes its mean action, and that remembers nothing "
            "but the state which `act(observation, state)` is given and gives with the action"
        )
    digest = hashlib.sha256(b"integ-gym behaviour 1\n")
    first, later = runs[0]
    remembers = not np.array_equal(first, later, equal_nan=True)
    for array in (observations, first, later) if remembers else (observations, first):
        digest.update(np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def _takes(function: Any, name: str) -> bool:
    """Whether a function takes something of this name behind the observation."""
    try:
        return name in [*inspect.signature(function).parameters][1:]
    except (TypeError, ValueError):
        return False


def _stack(given: Iterable[Any]) -> NDArray[Any]:
    return np.stack([_array(one) for one in given])


def _array(given: Any) -> NDArray[Any]:
    """An array, also of what torch gives."""
    return np.asarray(given.detach().cpu() if hasattr(given, "detach") else given)
