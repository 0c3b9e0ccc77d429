"""ONNX files: policies run by onnxruntime, and export."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from integ_gym.support.errors import InputError
from integ_gym.support.files import parse_json, read_bounded
from integ_gym.support.optional import load

from ..policy import ActionArray, DiscreteActions, MlpPolicy, ObservationStatistics
from .card import PolicyFileError, check_own_hash, hashed

METADATA = "integ_gym"
"""Key of the metadata that holds what a side-car does, as JSON."""

FORMAT = "integ-gym ONNX 1"

MAX_BYTES = 512 * 2**20
"""Largest file that is read."""

_PROBES = 32
"""Observations by which it is found out whether a batch of up to so many changes a bit."""


def onnx() -> Any:
    """The package that reads and writes graphs.

    Raises:
        ModuleNotFoundError: if it is missing, with the command that installs it.
    """
    return load("onnx", "onnx")


@dataclass(frozen=True, eq=False)
class OnnxPolicy:
    """A graph from observations to actions, or to the values of discrete ones.

    An action does not depend on how many observations are given: a graph that takes one at a time
    is widened, and one for which onnxruntime's numbers would depend on that gets them one by one.

    Attributes:
        content: the file's.
        discrete: whether its environment has discrete actions.
        policy_id: name that people read in tables; it is not part of `content_hash`.
        statistics: scaling of observations in front of the graph; None where there is none.
    """

    content: bytes
    discrete: bool = False
    policy_id: str = "onnx"
    statistics: ObservationStatistics | None = None
    any_batch: ClassVar[bool] = True

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 (hex) of the file, and of the statistics if there are any."""
        digest = hashlib.sha256(self.content)
        if (own := self.statistics) is not None:
            digest.update(np.array([*own.mean, *own.var, own.epsilon, own.clip_obs]).tobytes())
        return digest.hexdigest()

    def __getstate__(self) -> dict[str, Any]:
        """Without what runs it, which another process makes anew."""
        return {k: v for k, v in self.__dict__.items() if k not in ("_session", "_of_batches")}

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

    def outputs(self, observations: NDArray[Any]) -> NDArray[Any]:
        """What the graph gives for each of a batch of observations, shape (n, …)."""
        given = np.asarray(observations)
        if self.statistics is not None:
            given = self.statistics.normalize(given.reshape(len(given), -1))
        given = given.astype(np.float64 if "double" in self._input.type else np.float32)
        shape = self.observation_shape
        if shape is not None and math.prod(shape) == math.prod(given.shape[1:]):
            given = given.reshape(len(given), *shape)
        if len(given) == 1 or self._of_batches is None:
            return np.concatenate([self._run(self._session, row[None])[:1] for row in given])
        return self._run(self._of_batches, given)

    @cached_property
    def _of_batches(self) -> Any:
        """A session whose batches give the numbers, to the last bit, that their observations give
        alone; None where there is none."""
        shape = self.observation_shape
        if shape is None:
            return None
        dtype = np.float64 if "double" in self._input.type else np.float32
        probes = np.random.default_rng(0).normal(size=(_PROBES, *shape)).astype(dtype)
        alone = np.concatenate([self._run(self._session, row[None])[:1] for row in probes])
        try:
            fixed = isinstance(self._input.shape[0], int)
            session = self._open_session(_widen(self.content)) if fixed else self._session
            batches = [self._run(session, probes[:count]) for count in range(1, _PROBES + 1)]
        except Exception:  # onnxruntime's and protobuf's errors have no common class
            return None
        every = enumerate(batches, 1)
        return session if all(np.array_equal(own, alone[:n]) for n, own in every) else None

    def _run(self, session: Any, given: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(session.run(None, {self._input.name: given})[0])

    @property
    def _input(self) -> Any:
        taken = self._session.get_inputs()
        if len(taken) != 1:
            raise PolicyFileError(
                f"takes {len(taken)} inputs, and only a graph from observations alone can be "
                "judged; a policy that remembers is not judged here"
            )
        return taken[0]

    @property
    def observation_shape(self) -> tuple[int, ...] | None:
        """Shape of one observation, behind the number of them; None where the graph leaves it
        open."""
        sizes = tuple(self._input.shape[1:])
        return sizes if sizes and all(isinstance(size, int) for size in sizes) else None

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Actions for a batch of observations; see `Policy.act`."""
        given = self.outputs(observations)
        if not self.discrete:
            return given.reshape(len(observations), -1).astype(np.float32)
        rows = given.reshape(len(observations), -1)
        chosen = rows.argmax(axis=1) if rows.dtype.kind == "f" and rows.shape[1] > 1 else rows[:, 0]
        return chosen.astype(np.int64)

    def check_spaces(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
    ) -> None:
        """Check that the graph takes these observations and gives as many actions.

        Raises:
            ValueError: in one sentence, if not.
        """
        shape, own = observation_space.shape or (), self._input.shape
        size = math.prod(shape)
        try:
            given = self.act(np.zeros((1, size), np.float32))
        except PolicyFileError:
            raise
        except Exception as error:  # onnxruntime's errors have no common class
            raise InputError(
                f"policy {self.policy_id!r} takes an input of shape {tuple(own)} and the "
                f"environment gives observations of shape {shape}, as a batch of shape "
                f"(1, {size}); evaluate it in the kind of environment it was trained in"
            ) from error
        count = 1 if self.discrete else math.prod(action_space.shape or ())
        if given.size != count:
            raise InputError(
                f"policy {self.policy_id!r} gives {given.size} numbers for an action and the "
                f"environment takes {action_space}; evaluate it in the kind of environment it was "
                "trained in"
            )


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
    content, model = _parsed(path)
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
    _, model = _parsed(path)
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
    tensors = _parsed(path)[1].graph.initializer
    apart = {helper.ExternalDataInfo(one).location for one in tensors if one.external_data}
    return [path.parent / place for place in sorted(apart)]


def _parsed(path: Path) -> tuple[bytes, Any]:
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
    told = hashed({"format": FORMAT, **card})
    helper.set_model_props(model, {METADATA: json.dumps(told, allow_nan=False)})
    package.checker.check_model(model)
    content: bytes = model.SerializeToString()
    return content
