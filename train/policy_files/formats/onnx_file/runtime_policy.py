"""A policy whose graph onnxruntime runs."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ....policy.arrays import ActionArray
from ...error import PolicyFileError
from .packages import onnxruntime


@dataclass(frozen=True, eq=False)
class OnnxPolicy:
    """A graph from observations to actions, or to the values of discrete ones.

    Observations are given one by one, so that actions do not depend on how many there are.

    Attributes:
        content: the file's.
        discrete: whether its environment has discrete actions.
        policy_id: name that people read in tables; it is not part of `content_hash`.
    """

    content: bytes
    discrete: bool = False
    policy_id: str = "onnx"

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 (hex) of the file."""
        return hashlib.sha256(self.content).hexdigest()

    def __getstate__(self) -> dict[str, Any]:
        """Without what runs it, which another process makes anew."""
        return {k: v for k, v in self.__dict__.items() if k != "_session"}

    @cached_property
    def _session(self) -> Any:
        runtime = onnxruntime()
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            return runtime.InferenceSession(
                self.content, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # onnxruntime's errors have no common class
            text = " ".join(str(error).split())[:200]
            raise PolicyFileError(f"onnxruntime cannot run it ({text}); export it again") from error

    def outputs(self, observations: NDArray[Any]) -> NDArray[Any]:
        """What the graph gives for each of a batch of observations, shape (n, …)."""
        one = self._input
        dtype = np.float64 if "double" in one.type else np.float32
        given = np.asarray(observations, dtype=dtype)
        shape = self.observation_shape
        if shape is not None and math.prod(shape) == math.prod(given.shape[1:]):
            given = given.reshape(len(given), *shape)
        return np.concatenate(
            [np.asarray(self._session.run(None, {one.name: row[None]})[0])[:1] for row in given]
        )

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
            raise ValueError(
                f"policy {self.policy_id!r} takes an input of shape {tuple(own)} and the "
                f"environment gives observations of shape {shape}, as a batch of shape "
                f"(1, {size}); evaluate it in the kind of environment it was trained in"
            ) from error
        count = 1 if self.discrete else math.prod(action_space.shape or ())
        if given.size != count:
            raise ValueError(
                f"policy {self.policy_id!r} gives {given.size} numbers for an action and the "
                f"environment takes {action_space}; evaluate it in the kind of environment it was "
                "trained in"
            )
