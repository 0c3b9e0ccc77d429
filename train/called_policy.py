"""Policies that are called one observation, or one stack of observations, at a time."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from integ_gym.support.errors import InputError, InputTypeError

from .policy import (
    ACTIVATIONS,
    ActionArray,
    BoxActions,
    FloatArray,
    MlpPolicy,
    Policy,
    network_outputs,
)

Array = NDArray[Any]


class PolicyStack:
    """Policies that act together: networks of one shape as one product of stacked matrices.

    A policy's actions are those of its own `act` on its own observations, to the last bit,
    whichever policies are beside it.

    Args:
        policies: at least one, all for the same kind of actions.
    """

    def __init__(self, policies: Sequence[Policy]) -> None:
        self._count = len(policies)
        self._parts = [_part(policies, places) for places in _alike(policies)]

    def act(self, observations: Array) -> NDArray[np.float64]:
        """Actions of every policy.

        Args:
            observations: shape (policies, n, obs_dim), in the environment's units.

        Returns:
            Shape (policies, n, action_dim) for a `Box` action space, (policies, n) for a
            `Discrete` one.

        Raises:
            ValueError: as `Policy.act` does.
        """
        taken = [(places, act(observations[places])) for places, act in self._parts]
        actions = np.empty((self._count, *taken[0][1].shape[1:]))
        for places, values in taken:
            actions[places] = values
        return actions


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
) -> tuple[list[int], Callable[[Array], Array]]:
    chosen = [policies[place] for place in places]
    if len(chosen) > 1:
        return places, _together(chosen)  # type: ignore[arg-type]
    return places, lambda observations: chosen[0].act(observations[0])[None]


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


Way = Literal["act", "predict", "deterministic predict", "call"]


@dataclass(frozen=True, eq=False)
class CalledPolicy:
    """A policy in somebody else's code, asked as its author asks it.

    With ``act`` or ``predict``, as of stable-baselines3, it is given a batch of observations, and
    ``deterministic=True`` where ``predict`` takes that; anything else that is callable is given one
    observation at a time, so that its actions do not depend on how many are asked for.

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
        predict = getattr(self.target, "predict", None)
        if predict is not None:
            return "deterministic predict" if _takes_deterministic(predict) else "predict"
        if not callable(self.target):
            raise InputTypeError(
                f"a policy must be callable or have `predict`, got {type(self.target).__name__}; "
                "give a function from one observation to one action"
            )
        return "call"

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Actions for a batch of observations.

        Args:
            observations: shape (n, obs_dim), in the environment's units.

        Returns:
            float32 of shape (n, action_dim), beyond the bounds where the policy goes beyond them;
            int64 of shape (n,) for a `Discrete` action space.

        Raises:
            ValueError: if it fails, or what comes back are no such actions.
        """
        try:
            given = self._ask(observations)
        except Exception as error:
            raise InputError(
                f"policy {self.policy_id!r} raised {type(error).__name__}: {error}; give a "
                f"function from one observation, an array of shape {observations.shape[1:]}, to "
                "one action"
            ) from error
        return self._as_actions(given, len(observations))

    def _ask(self, observations: NDArray[Any]) -> NDArray[Any]:
        way = self._way()
        if way == "call":
            return np.stack([_array(self.target(one)) for one in observations])
        if way == "act":
            return _array(self.target.act(observations))
        if way == "predict":
            return _array(_first(self.target.predict(observations)))
        return _array(_first(self.target.predict(observations, deterministic=True)))

    def _as_actions(self, given: NDArray[Any], count: int) -> ActionArray:
        discrete = isinstance(self.action_space, spaces.Discrete)
        size = 1 if discrete else int(np.prod(self.action_space.shape or ()))
        if given.size != count * size or given.dtype.kind not in "biuf":
            raise InputError(
                f"policy {self.policy_id!r} gave an array of shape {given.shape} and type "
                f"{given.dtype} for {count} observations, where {count} actions of "
                f"{self.action_space} were expected; give one action for one observation"
            )
        if not discrete:
            actions: NDArray[np.float32] = given.reshape(count, size).astype(np.float32)
            return actions
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
    first, second = policy.act(observations), policy.act(observations)
    if not np.array_equal(first, second, equal_nan=True):
        raise InputError(
            f"policy {policy.policy_id!r} gives other actions when it is asked again about the "
            "same observations; judge one that does not remember and takes its mean action"
        )
    digest = hashlib.sha256(b"integ-gym behaviour 1\n")
    for array in (observations, first):
        digest.update(np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def _takes_deterministic(predict: Any) -> bool:
    try:
        return "deterministic" in inspect.signature(predict).parameters
    except (TypeError, ValueError):
        return False


def _first(given: Any) -> Any:
    """Actions alone of the pair (actions, state)."""
    return given[0] if isinstance(given, tuple) else given


def _array(given: Any) -> NDArray[Any]:
    """An array, also of what torch gives."""
    return np.asarray(given.detach().cpu() if hasattr(given, "detach") else given)
