"""A feed-forward network, or a stack of them, from features to outputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from .arrays import FloatArray

Layer: TypeAlias = tuple[FloatArray, FloatArray]


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
