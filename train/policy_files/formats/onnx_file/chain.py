"""A graph as a chain of steps from the observations to its output, where it is one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from integ_gym.support.packages.extras import load

from .packages import ACTIVATION_OPS, onnx

Array = NDArray[np.float64]

_ACTIVATIONS = {operator: name for name, operator in ACTIVATION_OPS.items()}
_DEFAULTS: dict[str, dict[str, Any]] = {
    "LeakyRelu": {"alpha": 0.01},
    "Elu": {"alpha": 1.0},
    "Gelu": {"approximate": b"none"},
}
_FOLDED = (
    *("Add", "Sub", "Mul", "Div", "Sqrt", "Neg", "Cast", "Identity"),
    *("Transpose", "Reshape", "Squeeze", "Unsqueeze"),
)
_PASSED = ("Identity", "Cast", "Flatten", "Dropout")


class NotAChain(Exception):
    """A graph that is no feed-forward network; onnxruntime runs it."""


class Step(NamedTuple):
    """One step: ``layer`` (weight, bias), ``activation`` (name), ``add``, ``multiply`` (array),
    ``least``, ``most`` (array), ``argmax``."""

    kind: str
    given: Any = None


def steps_of(graph: Any) -> list[Step]:
    """The steps of a graph with one input and one output.

    Raises:
        NotAChain: for another.
    """
    names = {one.name for one in graph.initializer}
    inputs = [one for one in graph.input if one.name not in names]
    if len(inputs) != 1 or len(graph.output) != 1:
        raise NotAChain
    constants = _constants(graph)
    nodes = [node for node in graph.node if not set(node.output) <= set(constants)]
    return _merged([*_walk(nodes, inputs[0].name, graph.output[0].name, constants)])


def _constants(graph: Any) -> dict[str, Any]:
    helper = onnx().numpy_helper
    found = {one.name: helper.to_array(one) for one in graph.initializer}
    for node in graph.node:
        if node.op_type == "Constant":
            value = [a for a in node.attribute if a.name == "value"]
            if value:
                found[node.output[0]] = helper.to_array(value[0].t)
        elif node.op_type in _FOLDED and node.input and set(node.input) <= set(found):
            evaluator = load("onnx.reference", "onnx").ReferenceEvaluator(node)
            (made,) = evaluator.run(None, {name: found[name] for name in node.input})
            found[node.output[0]] = made
    return found


def _walk(nodes: list[Any], value: str, end: str, constants: dict[str, Any]) -> Iterator[Step]:
    while value != end:
        users = [node for node in nodes if value in node.input]
        if {node.op_type for node in users} == {"Sigmoid", "Mul"} and len(users) == 2:
            gate = next(node for node in users if node.op_type == "Sigmoid")
            product = next(node for node in users if node.op_type == "Mul")
            if set(product.input) != {value, gate.output[0]}:
                raise NotAChain
            yield Step("activation", "SiLU")
            value = product.output[0]
            continue
        if len(users) != 1:
            raise NotAChain
        (node,) = users
        yield from _step(node, value, constants)
        value = node.output[0]


def _step(node: Any, value: str, constants: dict[str, Any]) -> Iterator[Step]:
    attributes = {a.name: onnx().helper.get_attribute_value(a) for a in node.attribute}
    operator = node.op_type
    others = [name for name in node.input if name != value]
    if any(name and name not in constants for name in others):
        raise NotAChain
    given: list[Any] = [constants[name] if name else None for name in others]
    if operator in _PASSED or (operator == "Reshape" and _keeps_rows(given)):
        return
    if operator in _ACTIVATIONS and _default(operator, attributes):
        yield Step("activation", _ACTIVATIONS[operator])
    elif operator == "Gemm":
        yield Step("layer", _gemm(given, attributes))
    elif operator == "MatMul" and node.input[0] == value and given[0].ndim == 2:
        yield Step("layer", (given[0].T, np.zeros(given[0].shape[1])))
    elif operator == "ArgMax" and attributes.get("axis", 0) in (1, -1):
        yield Step("argmax")
    elif operator == "Clip":
        ends = [*given, None, None][:2]
        yield from (
            Step(kind, _row(x))
            for kind, x in zip(("least", "most"), ends, strict=True)
            if x is not None
        )
    elif operator in ("Max", "Min") and len(given) == 1:
        yield Step("least" if operator == "Max" else "most", _row(given[0]))
    elif operator in ("Add", "Mul") and len(given) == 1:
        yield Step({"Add": "add", "Mul": "multiply"}[operator], _row(given[0]))
    elif operator in ("Sub", "Div") and len(given) == 1 and node.input[0] == value:
        own = _row(given[0])
        yield Step("add", -own) if operator == "Sub" else Step("multiply", 1.0 / own)
    else:
        raise NotAChain


def _default(operator: str, attributes: dict[str, Any]) -> bool:
    """Whether an activation's parameters are those of the torch class."""
    if operator == "Selu":
        return True
    expected = _DEFAULTS.get(operator, {})
    return all(
        value == expected.get(name)
        if isinstance(value, bytes)
        else np.isclose(value, expected[name])
        for name, value in attributes.items()
    )


def _gemm(given: list[Any], attributes: dict[str, Any]) -> tuple[Any, Any]:
    plain = attributes.get("alpha", 1.0) == attributes.get("beta", 1.0) == 1.0
    if not plain or attributes.get("transA", 0):
        raise NotAChain
    weight = given[0] if attributes.get("transB", 0) else given[0].T
    bias = given[1] if len(given) > 1 and given[1] is not None else np.zeros(len(weight))
    return weight, np.broadcast_to(_row(bias), (len(weight),))


def _keeps_rows(given: list[Any]) -> bool:
    return (
        len(given) == 1 and given[0] is not None and len(given[0]) == 2 and given[0][0] in (-1, 0)
    )


def _row(values: Any) -> Array:
    """Numbers for one row: of shape (), or (k,)."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim > 1 and array.size != array.shape[-1]:
        raise NotAChain
    return array.reshape(-1) if array.size > 1 else array.reshape(())


def _merged(steps: list[Step]) -> list[Step]:
    """A sum right after a layer without one is its bias."""
    merged: list[Step] = []
    for step in steps:
        last = merged[-1] if merged else None
        if step.kind == "add" and last and last.kind == "layer" and not np.any(last.given[1]):
            weight = last.given[0]
            merged[-1] = Step("layer", (weight, np.broadcast_to(step.given, (len(weight),))))
        else:
            merged.append(step)
    return merged
