"""A feed-forward network, or a stack of them, with activations as torch computes them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from .arrays import FloatArray

Layer: TypeAlias = tuple[FloatArray, FloatArray]


def _sigmoid(x: FloatArray) -> FloatArray:
    decay: FloatArray = np.exp(-np.abs(x))
    numerator: FloatArray = np.where(x >= 0, np.float32(1.0), decay)
    return numerator / (1.0 + decay)


def _elu(x: FloatArray) -> FloatArray:
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0.0)))


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
    "ELU": _elu,
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
