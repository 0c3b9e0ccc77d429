"""Latency: whether commands act when they should, and what the delay costs."""

from __future__ import annotations

import numpy as np

from integ_gym.eval.diagnosis.actuation import actuator_limit
from integ_gym.eval.diagnosis.bench import Array, Commands, Rollout
from integ_gym.eval.diagnosis.handmade import TOLERANCE, described, metric
from integ_gym.eval.diagnosis.section import TRUTH, Diagnosis
from integ_gym.eval.diagnosis.subject import Subject

SECTION = "latency"

HALF_PERIODS = (1, 2, 3)
"""Latencies whose timing is checked, in half control periods."""

PERIODS = (2, 4)
"""Latencies that the hand-made controller meets, in control periods."""

_DECISIONS = 30


def diagnose_latency(diagnosis: Diagnosis) -> None:
    """Delay commands, and compare with the same commands given later."""
    for subject, integrator in diagnosis.pairs():
        _timing(diagnosis, subject, integrator)
        _cost(diagnosis, subject, integrator)


def _timing(diagnosis: Diagnosis, subject: Subject, integrator: str) -> None:
    commands = actuator_limit(subject) * np.sin(np.arange(1, _DECISIONS + 1))
    gaps = tuple(_gap(diagnosis, subject, integrator, commands, k) for k in HALF_PERIODS)
    diagnosis.add(
        SECTION, subject, integrator,
        "difference to commands given later, by 1/2, 1, 3/2 control periods", gaps, "SI",
        "0: the same motion bit by bit", max(gaps) == 0.0, steps=(0.5 * subject.control_period,),
    )  # fmt: skip


def _gap(
    diagnosis: Diagnosis, subject: Subject, integrator: str, commands: Array, halves: int
) -> float:
    half = 0.5 * subject.control_period
    duration = _DECISIONS * subject.control_period

    def follow(name: str, values: Array, period: float, latency: float) -> Rollout:
        return diagnosis.bench.open_loop(
            f"latency/{integrator}/{name}/{halves}", subject, integrator, half,
            Commands(name, values), subject.start[None], duration=duration,
            control_period=period, action_latency=latency,
        )  # fmt: skip

    delayed = follow("delayed", commands, subject.control_period, halves * half)
    later = np.concatenate([np.zeros(halves), np.repeat(commands, 2)])[: 2 * _DECISIONS]
    shifted = follow("shifted", later, half, 0.0)
    return float(np.abs(delayed.state - shifted.state[::2]).max())


def _cost(diagnosis: Diagnosis, subject: Subject, integrator: str) -> None:
    for env_id in subject.environments:
        period = subject.control_period
        rates = [
            (
                metric(diagnosis, SECTION, env_id, TRUTH, period, period, k * period),
                metric(diagnosis, SECTION, env_id, integrator, period, period, k * period),
            )
            for k in PERIODS
        ]
        if any(truth is None for truth, _ in rates) or integrator == TRUTH:
            continue
        truths, shares = (tuple(x or 0.0 for x in column) for column in zip(*rates, strict=True))
        diagnosis.add(
            SECTION, subject, integrator,
            f"success at latencies of {', '.join(map(str, PERIODS))} control periods, "
            f"{described(env_id)}", shares, "",
            f"{', '.join(f'{x:.2f}' for x in truths)} ± {TOLERANCE:g}, as on the truth",
            all(abs(a - b) <= TOLERANCE for a, b in zip(truths, shares, strict=True)),
            steps=(period,),
        )  # fmt: skip
