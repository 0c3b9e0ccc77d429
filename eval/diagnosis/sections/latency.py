"""Latency: whether commands act when they should, and what the delay costs."""

from __future__ import annotations

import numpy as np

from ..bench import Array as Array
from ..bench import Commands
from ..experiments import success_lines
from ..lines import Diagnosis, Expectation
from .actuation import actuator_limit

HALF_PERIODS = (1, 2, 3)
"""Latencies whose timing is checked, in half control periods."""

PERIODS = (2, 4)
"""Latencies that the hand-made controller meets, in control periods."""

DECISIONS = 30


def diagnose_latency(diagnosis: Diagnosis) -> None:
    """Delay commands, and compare with the same commands given later."""
    for integrator in diagnosis.integrators:
        _timing(diagnosis, integrator)
    period = diagnosis.subject.control_period
    late = [(period, k * period) for k in PERIODS]
    quantity = (
        f"success of the hand-made controller {', '.join(map(str, PERIODS))} control periods late"
    )
    for env_id in diagnosis.subject.environments:
        success_lines(diagnosis, env_id, quantity, late, late, (period,))


def _timing(diagnosis: Diagnosis, integrator: str) -> None:
    """A delayed motion equals that under later commands; one like no delay at all is wrong."""
    subject = diagnosis.subject
    half = 0.5 * subject.control_period
    commands = actuator_limit(subject) * np.sin(np.arange(1, DECISIONS + 1))
    at_once = _follow(diagnosis, integrator, "at_once", commands, 2, 0)
    wrong = []
    for halves in HALF_PERIODS:
        delayed = _follow(diagnosis, integrator, f"delayed_{halves}", commands, 2, halves)
        later = np.concatenate([np.zeros(halves), np.repeat(commands, 2)])[: 2 * DECISIONS]
        shifted = _follow(diagnosis, integrator, f"shifted_{halves}", later, 1, 0)[::2]
        delays = different(delayed, at_once) > 0
        wrong.append(float(different(delayed, shifted) if delays else len(delayed)))
    diagnosis.add(
        integrator,
        f"instants of {DECISIONS + 1} at which delayed commands differ from later ones, by 1/2, 1, "
        "3/2 control periods",
        wrong, "", Expectation("0: the same bit by bit", "exactly", not any(wrong)),
        steps=(half,),
    )  # fmt: skip


def different(a: Array, b: Array) -> int:
    """Instants at which two motions of shape (instants, n) differ; two that ended do not."""
    return int((~((a == b) | (np.isnan(a) & np.isnan(b)))).any(axis=1).sum())


def _follow(
    diagnosis: Diagnosis, integrator: str, name: str, values: Array, halves: int, latency: int
) -> Array:
    """States at control instants, shape (instants, n); times in halves of a control period."""
    subject = diagnosis.subject
    half = 0.5 * subject.control_period
    rollout = diagnosis.bench.open_loop(
        f"{diagnosis.section}/{name}/{integrator}", subject, integrator, half,
        Commands(name, values),
        subject.start[None], duration=DECISIONS * subject.control_period,
        control_period=halves * half, action_latency=latency * half,
    )  # fmt: skip
    states: Array = rollout.state[:, 0]
    return states
