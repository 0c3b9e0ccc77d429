"""A trained feed-forward actor: its weights, its actions, its hash."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from .actions import BoxActions, DiscreteActions
from .arrays import ActionArray, FloatArray, frozen
from .network import ACTIVATIONS, Layer, network_outputs
from .observation_statistics import ObservationStatistics

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
        layers = tuple((frozen(w, np.float32), frozen(b, np.float32)) for w, b in self.layers)
        object.__setattr__(self, "layers", layers)
        if self.activation not in ACTIVATIONS:
            raise ValueError(
                f"the activation {self.activation!r} is not known; "
                f"use one of {', '.join(sorted(ACTIVATIONS))}"
            )
        self._check_layers()
        if self.statistics is not None and self.statistics.mean.shape != self.observation_shape:
            raise ValueError(
                f"the observation statistics have shape {self.statistics.mean.shape} and the "
                f"policy takes observations of shape {self.observation_shape}; "
                "use the statistics saved with this policy"
            )

    def _check_layers(self) -> None:
        """Raise ValueError unless the layers chain up to the number of outputs and are finite."""
        if not self.layers:
            raise ValueError("a policy needs at least one layer, got none")
        for index, (weight, bias) in enumerate(self.layers):
            before = self.layers[index - 1][0].shape[0] if index else weight.shape[-1]
            if weight.ndim != 2 or weight.shape != (*bias.shape, before):
                raise ValueError(
                    f"layer {index} has a weight of shape {weight.shape} and a bias of shape "
                    f"{bias.shape} after {before} inputs; expected (out, {before}) and (out,)"
                )
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise ValueError(
                    f"layer {index} has weights that are not finite, so training diverged; "
                    "train again with a lower learning rate"
                )
        if len(self.layers[-1][1]) != self.actions.size:
            raise ValueError(
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
            raise ValueError(
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
            raise ValueError(
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
            raise ValueError(
                f"policy {self.policy_id!r} gives actions for {_describe(expected)} and the "
                f"environment takes {_describe(action_space)}; {remedy}"
            )


def _describe(space: spaces.Space[Any]) -> str:
    """A space in a few words: `Box of shape (3,)`, `Discrete(2)`, else the space's own text."""
    if isinstance(space, spaces.Box):
        return f"Box of shape {space.shape}"
    return str(space)
