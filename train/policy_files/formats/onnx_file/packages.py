"""The packages that read and run ONNX, and activations by their names in it."""

from __future__ import annotations

from typing import Any

from integ_gym.support.packages.extras import load

OPSET = 20
IR_VERSION = 10

ACTIVATION_OPS = {
    "Tanh": "Tanh",
    "ReLU": "Relu",
    "LeakyReLU": "LeakyRelu",
    "ELU": "Elu",
    "SELU": "Selu",
    "GELU": "Gelu",
    "Mish": "Mish",
    "Sigmoid": "Sigmoid",
    "Softplus": "Softplus",
    "Softsign": "Softsign",
}
"""Torch classes to operators with the same defaults; ReLU6 and SiLU are made of two."""

METADATA = "integ_gym"
"""Key of the metadata that holds what a side-car does, as JSON."""

FORMAT = "integ-gym ONNX 1"


def onnx() -> Any:
    """The package that reads and writes graphs.

    Raises:
        ModuleNotFoundError: if it is missing, with the command that installs it.
    """
    return load("onnx", "onnx")


def onnxruntime() -> Any:
    """The package that runs graphs.

    Raises:
        ModuleNotFoundError: if it is missing, with the command that installs it.
    """
    return load("onnxruntime", "onnx")
