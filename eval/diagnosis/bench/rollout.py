"""Episodes followed to their end and kept as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.evidence import RecordEvidence, RecordVectorEvidence
from integ_gym.train import Policy

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

    def largest_energy(self) -> float:
        """J, over all instants and lanes."""
        return float(np.nanmax(self.info["energy"]))

    def diverged(self) -> Array:
        """Whether an episode ended before its time, shape (lanes,)."""
        ended: Array = ~np.isfinite(self.info["energy"][-1])
        return ended


def follow_one(recorder: RecordEvidence, policy: Policy, start: Array) -> Rollout:
    """One episode of a single environment, from a given start of shape (n,)."""
    inner: Any = recorder.env.unwrapped
    timing = inner.setup.timing
    observation, info = recorder.reset(seed=SEED, options={"state": start})
    names = [name for name, x in info.items() if not isinstance(x, str)]
    states, rows, success = [inner.state_components], [[info[n] for n in names]], False
    for _ in range(timing.horizon):
        action = policy.act(np.asarray(observation)[None])[0]
        observation, _, terminated, truncated, info = recorder.step(action)
        if info["solver_status"] == "diverged":
            break
        states.append(inner.state_components)
        rows.append([info[n] for n in names])
        success = bool(info["success"])
        if terminated or truncated:
            break
    table = _padded(rows, timing.horizon + 1)
    return Rollout(
        time=np.arange(timing.horizon + 1) * timing.control_period,
        state=_padded(states, timing.horizon + 1)[:, None],
        info={name: table[:, i, None] for i, name in enumerate(names)},
        success=np.array([success]),
    )


def _padded(rows: list[Any], length: int) -> Array:
    """Rows as an array of a given length, NaN where there is none."""
    table = np.full((length, len(rows[0])), np.nan)
    table[: len(rows)] = rows
    return table


def follow_lanes(recorder: RecordVectorEvidence, policy: Policy, starts: Array | None) -> Rollout:
    """One episode in every lane; starts of shape (lanes, n), or None for the task's own."""
    inner: Any = recorder.env.unwrapped
    timing = inner.setup.timing
    options = None if starts is None else {"state": starts}
    observation, info = recorder.reset(seed=SEED, options=options)
    names = [n for n, x in info.items() if not n.startswith("_") and x.dtype != object]
    state = np.full((timing.horizon + 1, *inner.state.shape), np.nan)
    booked = {name: np.full(state.shape[:2], np.nan) for name in names}
    running = np.ones(inner.num_envs, dtype=bool)
    success = ~running
    for instant in range(timing.horizon + 1):
        state[instant, running] = inner.state[running]
        for name in names:
            booked[name][instant, running] = info[name][running]
        if instant == timing.horizon:
            break
        observation, _, terminated, truncated, info = recorder.step(policy.act(observation))
        success |= running & info["success"]
        running = running & (info["solver_status"] != "diverged")
        if instant + 1 < timing.horizon:
            running = running & ~(terminated | truncated)
        if not running.any():
            break
    time = np.arange(timing.horizon + 1) * timing.control_period
    return Rollout(time, state, booked, success)
