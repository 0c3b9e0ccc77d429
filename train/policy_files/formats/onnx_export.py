"""A feed-forward policy as an ONNX graph: from raw observations to actions of the environment."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...policy.actions import BoxActions, DiscreteActions
from ...policy.mlp_policy import MlpPolicy
from ...policy.observation_statistics import ObservationStatistics
from ..own_hash import hashed
from .onnx_policy import FORMAT, METADATA, onnx

INPUT, OUTPUT = "observations", "actions"
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


def onnx_bytes(policy: MlpPolicy, card: Mapping[str, Any]) -> bytes:
    """The file's content.

    The graph takes ``observations``, float32 of shape (n, obs_dim), in the environment's units, and
    gives ``actions``: float32 of shape (n, action_dim), or int64 of shape (n,).

    Args:
        policy: what acts.
        card: what else its metadata holds, as a side-car does; JSON-serialisable.
    """
    graph = _Graph()
    value = INPUT
    if policy.statistics is not None:
        value = _normalized(graph, value, policy.statistics)
    for number, (weight, bias) in enumerate(policy.layers):
        if number:
            value = _activated(graph, value, policy.activation)
        value = graph.add("Gemm", [value, graph.constant(weight), graph.constant(bias)], transB=1)
    actions = policy.actions
    discrete = isinstance(actions, DiscreteActions)
    value = (
        graph.add("ArgMax", [value], axis=1, keepdims=0)
        if isinstance(actions, DiscreteActions)
        else _decoded(graph, value, actions)
    )
    return graph.file(value, policy.observation_shape[0], 0 if discrete else actions.size, card)


def _normalized(graph: _Graph, value: str, own: ObservationStatistics) -> str:
    """In float64, as `ObservationStatistics.normalize`."""
    double = onnx().TensorProto.DOUBLE
    value = graph.add("Cast", [value], to=double)
    value = graph.add("Sub", [value, graph.constant(own.mean)])
    value = graph.add("Div", [value, graph.constant(np.sqrt(own.var + own.epsilon))])
    ends = [graph.constant(np.float64(end)) for end in (-own.clip_obs, own.clip_obs)]
    value = graph.add("Clip", [value, *ends])
    return graph.add("Cast", [value], to=onnx().TensorProto.FLOAT)


def _activated(graph: _Graph, value: str, activation: str) -> str:
    if activation == "ReLU6":
        ends = [graph.constant(np.float32(end)) for end in (0.0, 6.0)]
        return graph.add("Clip", [value, *ends])
    if activation == "SiLU":
        return graph.add("Mul", [value, graph.add("Sigmoid", [value])])
    return graph.add(ACTIVATION_OPS[activation], [value])


def _decoded(graph: _Graph, value: str, actions: BoxActions) -> str:
    low, high = actions.low, actions.high
    if not actions.squash:
        value = graph.add("Min", [value, graph.constant(high)])
        return graph.add("Max", [value, graph.constant(low)])
    if actions.limit < math.inf:
        ends = [graph.constant(np.float32(end)) for end in (-actions.limit, actions.limit)]
        value = graph.add("Clip", [value, *ends])
    value = graph.add("Tanh", [value])
    value = graph.add("Add", [value, graph.constant(np.float32(1.0))])
    value = graph.add("Mul", [value, graph.constant(np.float32(0.5) * (high - low))])
    return graph.add("Add", [value, graph.constant(low)])


class _Graph:
    """Nodes and constants of a graph that is a chain."""

    def __init__(self) -> None:
        self._nodes: list[Any] = []
        self._constants: list[Any] = []

    def constant(self, values: NDArray[Any] | np.generic) -> str:
        name = f"constant_{len(self._constants)}"
        self._constants.append(onnx().numpy_helper.from_array(np.asarray(values), name))
        return name

    def add(self, operator: str, inputs: list[str], **attributes: Any) -> str:
        name = f"value_{len(self._nodes)}"
        self._nodes.append(onnx().helper.make_node(operator, inputs, [name], **attributes))
        return name

    def file(self, value: str, inputs: int, outputs: int, card: Mapping[str, Any]) -> bytes:
        helper, kinds = onnx().helper, onnx().TensorProto
        self._nodes.append(helper.make_node("Identity", [value], [OUTPUT]))
        taken = helper.make_tensor_value_info(INPUT, kinds.FLOAT, ["n", inputs])
        given = (
            helper.make_tensor_value_info(OUTPUT, kinds.FLOAT, ["n", outputs])
            if outputs
            else helper.make_tensor_value_info(OUTPUT, kinds.INT64, ["n"])
        )
        graph = helper.make_graph(self._nodes, "policy", [taken], [given], self._constants)
        model = helper.make_model(
            graph,
            opset_imports=[helper.make_opsetid("", OPSET)],
            ir_version=IR_VERSION,
            producer_name="integ-gym",
        )
        told = hashed({"format": FORMAT, **card})
        helper.set_model_props(model, {METADATA: json.dumps(told, allow_nan=False)})
        onnx().checker.check_model(model)
        content: bytes = model.SerializeToString()
        return content
