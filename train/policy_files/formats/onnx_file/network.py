"""A chain of steps as our own policy, where it is a normalization, a network, and actions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....policy.actions import BoxActions, DiscreteActions
from ....policy.mlp_policy import MOST, MlpPolicy
from ....policy.observation_statistics import ObservationStatistics
from .chain import NotAChain, Step

_NO_CLIP = 1e300
_NO_EPSILON = 1e-300


def policy_of(steps: list[Step], name: str) -> MlpPolicy:
    """The policy that a chain is.

    Raises:
        NotAChain: for another chain.
    """
    places = [k for k, step in enumerate(steps) if step.kind == "layer"]
    if not places:
        raise NotAChain
    first, last = places[0], places[-1]
    layers = tuple((steps[k].given[0], steps[k].given[1]) for k in places)
    activation = _activation(steps[first : last + 1])
    try:
        statistics = _statistics(steps[:first], layers[0][0].shape[1])
        actions = _actions(steps[last + 1 :], len(layers[-1][1]))
        return MlpPolicy(layers, activation, actions, statistics, name)
    except ValueError as error:
        raise NotAChain from error


def _activation(steps: list[Step]) -> str:
    """That which follows every layer but the last."""
    kinds: list[Any] = []
    between: list[Step] = []
    for step in steps[1:]:
        if step.kind == "layer":
            kinds.append(_named(between))
            between = []
        else:
            between.append(step)
    if len(set(kinds)) > 1:
        raise NotAChain
    return str(kinds[0]) if kinds else "Tanh"


def _named(between: list[Step]) -> str:
    if len(between) == 1 and between[0].kind == "activation":
        return str(between[0].given)
    ends = [
        (step.kind, float(step.given))
        for step in between
        if np.ndim(step.given) == 0 and step.kind != "activation"
    ]
    if ends == [("least", 0.0), ("most", 6.0)] and len(between) == 2:
        return "ReLU6"
    if ends == [("least", 0.0)] and len(between) == 1:
        return "ReLU"
    raise NotAChain


def _statistics(steps: list[Step], size: int) -> ObservationStatistics | None:
    """y = (x − mean) / scale, perhaps clipped to ±c."""
    if not steps:
        return None
    mean, scale = np.zeros(size), np.ones(size)
    ends: dict[str, float] = {}
    for step in steps:
        if step.kind in ("least", "most"):
            if np.ndim(step.given):
                raise NotAChain
            ends[step.kind] = float(step.given)
        elif ends or step.kind not in ("add", "multiply"):
            raise NotAChain
        elif step.kind == "add":
            mean = mean - step.given * scale
        else:
            scale = scale / step.given
    clip = ends.get("most", _NO_CLIP)
    if ends.get("least", -clip) != -clip or not (scale > 0.0).all():
        raise NotAChain
    return ObservationStatistics(mean, scale**2, _NO_EPSILON, clip)


def _actions(steps: list[Step], size: int) -> BoxActions | DiscreteActions:
    kinds = [step.kind for step in steps]
    if kinds == ["argmax"]:
        return DiscreteActions(size)
    squashing = [k for k, step in enumerate(steps) if step == Step("activation", "Tanh")]
    if len(squashing) == 1:
        (place,) = squashing
        return _squashed(steps[place + 1 :], _limit(steps[:place]), size)
    low: NDArray[np.float64] = np.full(size, -MOST)
    high: NDArray[np.float64] = np.full(size, MOST)
    for step in steps:
        if step.kind == "least":
            low, high = np.maximum(low, step.given), np.maximum(high, step.given)
        elif step.kind == "most":
            low, high = np.minimum(low, step.given), np.minimum(high, step.given)
        else:
            raise NotAChain
    return BoxActions(low.astype(np.float32), high.astype(np.float32))


def _limit(steps: list[Step]) -> float:
    """Size that outputs are limited to."""
    ends = {step.kind: step.given for step in steps}
    if not steps:
        return math.inf
    if set(ends) != {"least", "most"} or np.ndim(ends["most"]) or ends["least"] != -ends["most"]:
        raise NotAChain
    return float(ends["most"])


def _squashed(steps: list[Step], limit: float, size: int) -> BoxActions:
    """Sums and products after tanh: its ends −1 and 1 become the bounds."""
    low, high = np.full(size, -1.0), np.full(size, 1.0)
    for step in steps:
        if step.kind == "add":
            low, high = low + step.given, high + step.given
        elif step.kind == "multiply":
            low, high = low * step.given, high * step.given
        else:
            raise NotAChain
    return BoxActions(low.astype(np.float32), high.astype(np.float32), squash=True, limit=limit)
