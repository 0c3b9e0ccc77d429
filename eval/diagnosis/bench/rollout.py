"""Episodes followed to their end and kept as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.vector_recorder import RecordVectorEvidence
from integ_gym.train.policy import Policy

Array = npt.NDArray[Any]

SEED = 0
"""Of the first lane's start."""


@dataclass(frozen=True)
class Rollout:
    """Episodes side by side; NaN after the end of an episode.

    Attributes:
        time: control instants, s, shape (instants,).
        state: true states in state order, SI units, shape (instants, lanes, n).
        info: numbers of ``info`` at each instant, shape (instants, lanes), by name.
        success: whether each episode met its task, shape (lanes,).
        evaluations: of accelerations and Jacobians on the way; None where they were not counted.
    """

    time: Array
    state: Array
    info: Mapping[str, Array]
    success: Array
    evaluations: int | None = None

    def so_far(self, name: str) -> Array:
        """What was booked under a name up to each instant, shape (instants, lanes)."""
        sums: Array = np.cumsum(self.info[name], axis=0)
        return sums

    def residual(self) -> Array:
        """Σ |energy residual| over the control periods, J, shape (lanes,); NaN where diverged."""
        sums: Array = np.abs(self.info["energy_residual"]).sum(axis=0)
        return sums

    def diverged(self) -> Array:
        """Whether an episode ended before its time, shape (lanes,)."""
        ended: Array = ~np.isfinite(self.info["energy"][-1])
        return ended


def follow(
    recorder: RecordEvidence | RecordVectorEvidence, policy: Policy, starts: Array | None
) -> Rollout:
    """One episode of a single environment, or one in every lane.

    Args:
        recorder: of the environment.
        policy: what acts.
        starts: shape (n,) or (lanes, n); None: the task's own.
    """
    inner: Any = recorder.env.unwrapped
    timing, alone = inner.setup.timing, isinstance(recorder, RecordEvidence)
    options = None if starts is None else {"state": starts}
    observation, info = recorder.reset(seed=SEED, options=options)
    names = [n for n, x in info.items() if n[0] != "_" and np.asarray(x).dtype.kind in "biuf"]
    running = np.ones(np.shape(inner.state_components[0]), dtype=bool)
    success = ~running
    states, rows, lived = [], [], []
    for instant in range(timing.horizon + 1):
        states.append(np.array(inner.state_components))
        rows.append(np.array([info[name] for name in names], dtype=np.float64))
        lived.append(running)
        if instant == timing.horizon:
            break
        action = policy.act(np.asarray(observation)[None])[0] if alone else policy.act(observation)
        observation, _, terminated, truncated, info = recorder.step(action)
        success = success | (running & info["success"])
        running = running & (info["solver_status"] != "diverged")
        if instant + 1 < timing.horizon:
            running = running & ~np.logical_or(terminated, truncated)
        if not running.any():
            break
    booked = _table(rows, lived, timing.horizon + 1)
    return Rollout(
        time=np.arange(timing.horizon + 1) * timing.control_period,
        state=np.swapaxes(_table(states, lived, timing.horizon + 1), 1, 2),
        info={name: booked[:, i] for i, name in enumerate(names)},
        success=np.atleast_1d(success),
    )


def _table(rows: list[Array], lived: list[Array], length: int) -> Array:
    """Rows in an array of shape (length, numbers, lanes), NaN where there is none."""
    table = np.full((length, len(rows[0]), lived[0].size), np.nan)
    values = np.reshape(rows, (len(rows), *table.shape[1:]))
    table[: len(rows)] = np.where(np.reshape(lived, (len(rows), 1, -1)), values, np.nan)
    return table
