"""Many policies at once, each acting on its own observations."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .actions import BoxActions
from .arrays import ActionArray, FloatArray
from .interface import Policy
from .mlp_policy import MlpPolicy
from .network import ACTIVATIONS, network_outputs

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
