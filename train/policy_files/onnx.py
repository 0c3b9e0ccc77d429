"""ONNX files: policies run by onnxruntime, and export."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.support.files import parse_json, read_bounded
from integ_gym.support.optional import load

from ..policy import ActionArray, DiscreteActions, MlpPolicy
from .card import PolicyFileError, check_own_hash, hashed
from .programs import ProgramPolicy, columns_of

METADATA = "integ_gym"
"""Key of the metadata that holds what a side-car does, as JSON."""

FORMAT = "integ-gym ONNX 1"

MAX_BYTES = 512 * 2**20
"""Largest file that is read."""

_PROBES = 64
"""Observations by which it is found out whether a batch of up to so many changes a bit."""


def onnx() -> Any:
    """The package that reads and writes graphs.

    Raises:
        ModuleNotFoundError: if it is missing, with the command that installs it.
    """
    return load("onnx", "onnx")


@dataclass(frozen=True, eq=False)
class OnnxPolicy(ProgramPolicy):
    """A graph from observations to actions, or to the values of discrete ones.

    An action does not depend on how many observations are given: a graph that takes one at a time
    is widened, and one for which onnxruntime's numbers would depend on that gets them one by one.
    An input ``NAME_in`` that has an output ``NAME_out`` is its memory, of zeros when an episode
    begins. Of several other inputs, each is the part of the observation that has its name.
    """

    policy_id: str = "onnx"

    extra = "onnx"

    @property
    def any_batch(self) -> bool:
        """Whether it may be asked about any of its lanes together."""
        return not self._memory

    @cached_property
    def _session(self) -> Any:
        return self._open_session(self.content)

    def _open_session(self, content: bytes) -> Any:
        runtime = load("onnxruntime", "onnx")
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            return runtime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime's errors have no common class
            text = " ".join(str(error).split())[:200]
            raise PolicyFileError(f"onnxruntime cannot run it ({text}); export it again") from error

    @cached_property
    def _memory(self) -> dict[str, str]:
        """Inputs that carry its memory, to the outputs that say what they are next."""
        outputs = {one.name for one in self._session.get_outputs()}
        names = [one.name for one in self._session.get_inputs()]
        carried = {name: re.sub(r"(^|_)in(?=_|$)", r"\1out", name) for name in names}
        return {name: after for name, after in carried.items() if after in outputs - {name}}

    @cached_property
    def _inputs(self) -> list[tuple[Any, Any]]:
        """Inputs that take observations, each with the columns that it takes."""
        taken = [one for one in self._session.get_inputs() if one.name not in self._memory]
        if len(taken) == 1:
            return [(taken[0], slice(None))]
        columns = {one.name: columns_of(one.name, self.names) for one in taken}
        for name, own in columns.items():
            if not own:
                raise PolicyFileError(
                    f"takes the inputs {', '.join(columns)}, and no part of the observation is "
                    f"called {name!r}; give the observation as a dictionary of these names, call "
                    "an input of its memory NAME_in and the output NAME_out, or export the actor "
                    "alone"
                )
        return [(one, columns[one.name]) for one in taken]

    @property
    def takes(self) -> str:
        """Shapes of its inputs."""
        shapes = [str(tuple(one.shape)) for one, _ in self._inputs]
        return f"an input of shape {' and one of shape '.join(shapes)}"

    @cached_property
    def _output(self) -> str:
        """The output that has the actions."""
        names: list[str] = [one.name for one in self._session.get_outputs()]
        return next((name for name in names if name not in self._memory.values()), names[0])

    def begin(self) -> Callable[[NDArray[Any]], ActionArray]:
        """See :func:`~integ_gym.train.policy.start_acting`."""
        held: list[dict[str, Any]] = []

        def act(observations: NDArray[Any]) -> ActionArray:
            given = self._scale(observations)
            if not self._memory and len(given) > 1 and self._of_batches is not None:
                return self._as_actions(self._run(self._of_batches, given)[0], len(given))
            held.extend(self._first_memory for _ in given[len(held) :])
            rows = []
            for lane, row in enumerate(given):
                actions, held[lane] = self._run(self._session, row[None], held[lane])
                rows.append(actions[:1])
            return self._as_actions(np.concatenate(rows), len(given))

        return act

    @cached_property
    def _first_memory(self) -> dict[str, Any]:
        first = {}
        for one in self._session.get_inputs():
            if one.name in self._memory:
                shape = [size if isinstance(size, int) else 1 for size in one.shape]
                first[one.name] = np.zeros(shape, _dtype(one))
        return first

    @cached_property
    def _of_batches(self) -> Any:
        """A session whose batches give the numbers, to the last bit, that their observations give
        alone; None where there is none."""
        inputs = [one.shape for one, _ in self._inputs]
        if not all(shape[1:] and all(isinstance(x, int) for x in shape[1:]) for shape in inputs):
            return None
        several = len(inputs) > 1  # of what is observed, they may leave something out
        size = len(self.names) if several else sum(math.prod(shape[1:]) for shape in inputs)
        probes = np.random.default_rng(0).normal(size=(_PROBES, size))
        alone = np.concatenate([self._run(self._session, row[None])[0][:1] for row in probes])
        try:
            fixed = any(isinstance(shape[0], int) for shape in inputs)
            session = self._open_session(_widen(self.content)) if fixed else self._session
            batches = [self._run(session, probes[:count])[0] for count in range(1, _PROBES + 1)]
        except Exception:  # onnxruntime's and protobuf's errors have no common class
            return None
        every = enumerate(batches, 1)
        return session if all(np.array_equal(own, alone[:n]) for n, own in every) else None

    def _run(
        self, session: Any, given: NDArray[Any], memory: Mapping[str, Any] = MappingProxyType({})
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """What the graph gives for observations, and the memory after them."""
        feeds = dict(memory)
        for one, columns in self._inputs:
            part, shape = given[:, columns].astype(_dtype(one)), tuple(one.shape[1:])
            known = bool(shape) and all(isinstance(size, int) for size in shape)
            fits = known and math.prod(shape) == part[0].size
            feeds[one.name] = part.reshape(len(part), *shape) if fits else part
        actions, *after = session.run([self._output, *self._memory.values()], feeds)
        return np.asarray(actions), dict(zip(self._memory, after, strict=True))


def _dtype(taken: Any) -> Any:
    """NumPy's type for an input's."""
    name = str(taken.type).removeprefix("tensor(").removesuffix(")")
    return np.dtype({"float": "float32", "double": "float64", "float16": "float16"}.get(name, name))


def _widen(content: bytes) -> bytes:
    """A graph that takes one observation, made one that takes any number."""
    model = onnx().load_model_from_string(content)
    for value in (*model.graph.input, *model.graph.output):
        value.type.tensor_type.shape.dim[0].dim_param = "n"
    del model.graph.value_info[:]
    widened: bytes = model.SerializeToString()
    return widened


def read_onnx(path: Path) -> OnnxPolicy:
    """The policy of a file.

    Raises:
        PolicyFileError: in one sentence, if it cannot be read.
        ModuleNotFoundError: if the extra is missing, with the command that installs it.
    """
    content, model = _parse_graph(path)
    apart = [tensor for tensor in model.graph.initializer if tensor.external_data]
    if apart:
        _join(path, apart)
        content = model.SerializeToString()
    return OnnxPolicy(content, policy_id=path.stem)


def onnx_card(path: Path) -> dict[str, Any] | None:
    """What a file's metadata says, as a side-car does; None without any of ours.

    Raises:
        PolicyFileError: in one sentence, if it cannot be read or was edited.
    """
    _, model = _parse_graph(path)
    for prop in model.metadata_props:
        if prop.key == METADATA:
            try:
                card = parse_json(prop.value.encode())
            except ValueError:
                card = None
            if not isinstance(card, dict) or card.get("format") != FORMAT:
                raise PolicyFileError(
                    f"{path}: its metadata `{METADATA}` is not of format {FORMAT!r}; write the "
                    "file again with integ_gym.save_policy"
                )
            check_own_hash(card, path, "write the file again with integ_gym.save_policy")
            return card
    return None


def onnx_data(path: Path) -> list[Path]:
    """Files beside an ONNX file that hold its weights, which are its own wherever it is kept.

    Raises:
        PolicyFileError: in one sentence, if it cannot be read.
    """
    helper = load("onnx.external_data_helper", "onnx")
    tensors = _parse_graph(path)[1].graph.initializer
    apart = {helper.ExternalDataInfo(one).location for one in tensors if one.external_data}
    return [path.parent / place for place in sorted(apart)]


def _parse_graph(path: Path) -> tuple[bytes, Any]:
    """A file's bytes and its graph, weights beside it left there."""
    try:
        content = read_bounded(path, MAX_BYTES)
    except OSError as error:
        raise PolicyFileError(
            f"{path}: cannot be opened ({error.strerror}); check the path"
        ) from error
    except ValueError as error:
        raise PolicyFileError(f"{error}; give a smaller network") from None
    try:
        model = onnx().load_model_from_string(content)
    except ModuleNotFoundError:
        raise
    except Exception as error:  # a damaged file can fail in any way inside protobuf
        raise PolicyFileError(f"{path}: is not a readable ONNX file; export it again") from error
    return content, model


def _join(path: Path, tensors: list[Any]) -> None:
    """Read weights that are kept beside the file, as torch exports them.

    Raises:
        PolicyFileError: in one sentence, if they lie elsewhere, are missing or too large.
    """
    helper = load("onnx.external_data_helper", "onnx")
    places = {helper.ExternalDataInfo(tensor).location for tensor in tensors}
    for place in sorted(places):
        beside = path.parent / place
        if Path(place).name != place or beside.is_symlink() or not beside.is_file():
            raise PolicyFileError(
                f"{path}: keeps its weights in {place!r}, which is no file beside it; move them "
                "together, or export it as one file"
            )
    if sum((path.parent / place).stat().st_size for place in places) > MAX_BYTES:
        raise PolicyFileError(
            f"{path}: its weights are larger than {MAX_BYTES} bytes; give a smaller network"
        )
    try:
        for tensor in tensors:
            helper.load_external_data_for_tensor(tensor, str(path.parent))
    except Exception as error:  # a damaged file can fail in any way inside the reader
        raise PolicyFileError(
            f"{path}: the weights beside it do not fit it; export both again"
        ) from error


INPUT, OUTPUT = "observations", "actions"
OPSET = 20
IR_VERSION = 10

ACTIVATION_OPS = {
    **{name: name for name in ("Tanh", "Sigmoid", "Softplus", "Softsign", "Mish")},
    **{name: name.capitalize() for name in ("ELU", "SELU", "GELU")},
    "ReLU": "Relu",
    "LeakyReLU": "LeakyRelu",
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
    package = onnx()
    helper, kinds = package.helper, package.TensorProto
    nodes: list[Any] = []
    constants: list[Any] = []

    def add(operator: str, value: str, *numbers: Any, **attributes: Any) -> str:
        """A node of the chain, from a value and constants to another value."""
        inputs = [value]
        for number in numbers:
            if not isinstance(number, str):
                name = f"constant_{len(constants)}"
                constants.append(package.numpy_helper.from_array(np.asarray(number), name))
                number = name
            inputs.append(number)
        nodes.append(helper.make_node(operator, inputs, [f"value_{len(nodes)}"], **attributes))
        return f"value_{len(nodes) - 1}"

    value, own, actions = INPUT, policy.statistics, policy.actions
    if own is not None:  # in float64, as `ObservationStatistics.normalize`
        value = add("Cast", value, to=kinds.DOUBLE)
        value = add("Div", add("Sub", value, own.mean), np.sqrt(own.var + own.epsilon))
        value = add("Clip", value, np.float64(-own.clip_obs), np.float64(own.clip_obs))
        value = add("Cast", value, to=kinds.FLOAT)
    for number, (weight, bias) in enumerate(policy.layers):
        if number and policy.activation == "ReLU6":
            value = add("Clip", value, np.float32(0.0), np.float32(6.0))
        elif number and policy.activation == "SiLU":
            value = add("Mul", value, add("Sigmoid", value))
        elif number:
            value = add(ACTIVATION_OPS[policy.activation], value)
        value = add("Gemm", value, weight, bias, transB=1)
    if isinstance(actions, DiscreteActions):
        value = add("ArgMax", value, axis=1, keepdims=0)
        given = helper.make_tensor_value_info(OUTPUT, kinds.INT64, ["n"])
    else:
        low, high = actions.low, actions.high
        if not actions.squash:
            value = add("Max", add("Min", value, high), low)
        else:
            if actions.limit < math.inf:
                value = add("Clip", value, np.float32(-actions.limit), np.float32(actions.limit))
            value = add("Add", add("Tanh", value), np.float32(1.0))
            value = add("Add", add("Mul", value, np.float32(0.5) * (high - low)), low)
        given = helper.make_tensor_value_info(OUTPUT, kinds.FLOAT, ["n", actions.size])
    nodes.append(helper.make_node("Identity", [value], [OUTPUT]))
    inputs = ["n", policy.observation_shape[0]]
    taken = helper.make_tensor_value_info(INPUT, kinds.FLOAT, inputs)
    graph = helper.make_graph(nodes, "policy", [taken], [given], constants)
    model = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="integ-gym",
    )
    hashed_card = hashed({"format": FORMAT, **card})
    helper.set_model_props(model, {METADATA: json.dumps(hashed_card, allow_nan=False)})
    package.checker.check_model(model)
    content: bytes = model.SerializeToString()
    return content
