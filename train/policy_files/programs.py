"""Policies that are programs, run by what reads their files: what graphs and TorchScript share."""

from __future__ import annotations

import hashlib
import io
import math
import warnings
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import count, takewhile
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from integ_gym.support.errors import InputError
from integ_gym.support.optional import missing_package

from ..policy import ActionArray, ObservationStatistics
from .card import PolicyFileError


@dataclass(frozen=True, eq=False)
class ProgramPolicy:
    """A program from observations to actions, or to the values of discrete ones.

    Attributes:
        content: the file's.
        discrete: whether its environment has discrete actions.
        policy_id: name that people read in tables; it is not part of `content_hash`.
        statistics: scaling of observations in front of the program; None where there is none.
        names: of the numbers of an observation, where the environment says them.
    """

    content: bytes
    discrete: bool = False
    policy_id: str = "program"
    statistics: ObservationStatistics | None = None
    names: tuple[str, ...] = ()

    extra: ClassVar[str]
    """What installs all that it needs."""

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 (hex) of the file, and of the statistics if there are any."""
        digest = hashlib.sha256(self.content)
        if (own := self.statistics) is not None:
            digest.update(np.array([*own.mean, *own.var, own.epsilon, own.clip_obs]).tobytes())
        return digest.hexdigest()

    def __getstate__(self) -> dict[str, Any]:
        """Without what runs it, which another process makes anew."""
        return {one.name: vars(self)[one.name] for one in fields(self)}

    def begin(self) -> Callable[[NDArray[Any]], ActionArray]:
        """See :func:`~integ_gym.train.policy.start_acting`."""
        raise NotImplementedError

    @property
    def takes(self) -> str:
        """What it is given, in words."""
        return "another input"

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Actions for a batch of observations, with which episodes begin; see `Policy.act`."""
        return self.begin()(observations)

    def _scale(self, observations: NDArray[Any]) -> NDArray[Any]:
        """What it is given, shape (n, obs_dim)."""
        given = np.asarray(observations).reshape(len(observations), -1)
        return given if self.statistics is None else self.statistics.normalize(given)

    def _as_actions(self, given: NDArray[Any], lanes: int) -> ActionArray:
        rows = given.reshape(lanes, -1)
        if not self.discrete:
            return rows.astype(np.float32)
        chosen = rows.argmax(axis=1) if rows.dtype.kind == "f" and rows.shape[1] > 1 else rows[:, 0]
        return chosen.astype(np.int64)

    def check_spaces(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
    ) -> None:
        """Check that it takes these observations and gives as many actions.

        Raises:
            ValueError: in one sentence, if not.
        """
        shape = observation_space.shape or ()
        size = math.prod(shape)
        try:
            given = self.act(np.zeros((1, size), np.float32))
        except (ModuleNotFoundError, PolicyFileError):
            raise
        except Exception as error:  # neither onnxruntime's errors nor a program's have a class
            raise InputError(
                f"policy {self.policy_id!r} takes {self.takes} and the environment gives "
                f"observations of shape {shape}, as a batch of shape (1, {size}); evaluate it in "
                "the kind of environment it was trained in"
            ) from error
        if given.size != (1 if self.discrete else math.prod(action_space.shape or ())):
            raise InputError(
                f"policy {self.policy_id!r} gives {given.size} numbers for an action and the "
                f"environment takes {action_space}; evaluate it in the kind of environment it was "
                "trained in"
            )


def columns_of(name: str, names: Sequence[str]) -> list[int]:
    """Where a part of an observation is: ``name`` itself, or ``name0``, ``name1`` and so on."""
    parts = takewhile(names.__contains__, (f"{name}{index}" for index in count()))
    return [names.index(part) for part in ([name] if name in names else parts)]


@dataclass(frozen=True, eq=False)
class TorchScriptPolicy(ProgramPolicy):
    """A TorchScript program, which torch runs: only what its user consented to may act.

    Every lane has a program of its own, so that what it keeps in its buffers, as a recurrent export
    of rsl_rl does, is of one episode alone.
    """

    policy_id: str = "torchscript"

    extra = "train"

    def begin(self) -> Callable[[NDArray[Any]], ActionArray]:
        """See :func:`~integ_gym.train.policy.start_acting`."""
        lanes: list[Any] = []

        def act(observations: NDArray[Any]) -> ActionArray:
            import torch

            given = torch.as_tensor(self._scale(observations).astype(np.float32))
            if not lanes:
                lanes.extend(self._load() for _ in given)
            with torch.inference_mode():
                rows = [lane(row[None]) for lane, row in zip(lanes, given, strict=True)]
            return self._as_actions(np.concatenate([row.numpy() for row in rows]), len(given))

        return act

    def _load(self) -> Any:
        try:
            import torch
        except ImportError:
            raise missing_package("torch", "train") from None
        with warnings.catch_warnings(action="ignore", category=DeprecationWarning):
            program: Any = torch.jit.load(io.BytesIO(self.content), map_location="cpu").eval()  # type: ignore[no-untyped-call]
        if hasattr(program, "reset"):
            asked = [
                x.name for x in program.reset.schema.arguments[1:] if not x.has_default_value()
            ]
            if asked:
                names = ", ".join(asked)
                raise PolicyFileError(
                    f"its method `reset` asks for {names}; export one that asks for nothing"
                )
            program.reset()
        return program


def is_torchscript(path: Path) -> bool:
    """Whether a file is a TorchScript program, which `torch.jit.save` wrote."""
    if not (path.is_file() and zipfile.is_zipfile(path)):
        return False
    with zipfile.ZipFile(path) as archive:
        return any(Path(name).name == "constants.pkl" for name in archive.namelist())
