"""Timestep refinement at a fixed control period: trajectory, energy, task, and cost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from integ_gym.envs.engines.native import NativeEngine
from integ_gym.envs.numerics import declared
from integ_gym.envs.ops import SCALAR
from integ_gym.envs.plants.interface import join_state, split_state
from integ_gym.envs.system import PlantSystem
from integ_gym.eval.diagnosis.actuation import actuator_limit
from integ_gym.eval.diagnosis.bench import Array, Commands, Rollout
from integ_gym.eval.diagnosis.handmade import TOLERANCE, described, metric
from integ_gym.eval.diagnosis.ledger import ledger_line
from integ_gym.eval.diagnosis.order import promised
from integ_gym.eval.diagnosis.section import TRUTH, Diagnosis
from integ_gym.eval.diagnosis.subject import Subject

SECTION = "timestep refinement"

HALVINGS = 8
"""Steps on the convergence and work-precision curves."""

_SHARE = 0.5
"""Amplitude of the command in units of the actuator's limit."""

_EXACT = 1e-9


def diagnose_refinement(diagnosis: Diagnosis) -> None:
    """The same commands, and the same controller, at ever smaller steps."""
    truths: dict[str, Rollout] = {}
    for subject, integrator in diagnosis.pairs():
        if subject.name not in truths:
            truths[subject.name] = _driven(diagnosis, subject, TRUTH, subject.steps[0])
        truth = truths[subject.name]
        if integrator != TRUTH:
            _trajectory(diagnosis, subject, integrator, truth)
            _curve(diagnosis, subject, integrator, truth)
        _task(diagnosis, subject, integrator)


def _commands(subject: Subject) -> Array:
    """One period of a sine, held over each control period."""
    count = math.ceil(subject.period / subject.control_period)
    wave: Array = np.sin(2.0 * math.pi * np.arange(count) / count)
    return _SHARE * actuator_limit(subject) * wave


def _driven(diagnosis: Diagnosis, subject: Subject, integrator: str, dt: float) -> Rollout:
    commands = _commands(subject)
    truth = "truth/" if integrator == TRUTH else ""
    return diagnosis.bench.open_loop(
        f"refinement/{truth}{integrator}/dt={dt:g}", subject, integrator, dt,
        Commands("sine", commands), subject.start[None],
        duration=len(commands) * subject.control_period,
    )  # fmt: skip


def _trajectory(diagnosis: Diagnosis, subject: Subject, integrator: str, truth: Rollout) -> None:
    rollouts = [_driven(diagnosis, subject, integrator, dt) for dt in subject.steps]
    errors = tuple(_error(subject, r.state[:, 0], truth.state[:, 0]) for r in rollouts)
    expected, holds = promised(subject, integrator, errors, _EXACT)
    diagnosis.add(
        SECTION, subject, integrator, "largest trajectory error in one driven period", errors,
        "rad or m", expected, holds, steps=subject.steps,
    )  # fmt: skip
    ledger_line(diagnosis, SECTION, subject, integrator, rollouts)


def _error(subject: Subject, states: Array, truth: Array) -> float:
    """Largest error of (q, v / ω) at any control instant."""
    weights = np.tile([1.0, 1.0 / subject.frequency], len(subject.plant.coordinates))
    error = np.abs(states - truth) * weights
    return float(error.max()) if np.isfinite(error).all() else math.inf


def _curve(diagnosis: Diagnosis, subject: Subject, integrator: str, truth: Rollout) -> None:
    """Error and number of right-hand sides over a longer ladder of steps."""
    steps, errors, costs = [], [], []
    for halving in range(HALVINGS):
        states, cost = _counted(subject, integrator, 2**halving)
        steps.append(subject.control_period / 2**halving)
        errors.append(_error(subject, states, truth.state[:, 0]))
        costs.append(cost / truth.time[-1])
    diagnosis.draw(
        "refinement", plant=subject.name, integrator=integrator, steps=steps,
        errors=[x if math.isfinite(x) else None for x in errors], evaluations_per_second=costs,
        order=declared(integrator).order,
    )  # fmt: skip


def _counted(subject: Subject, integrator: str, substeps: int) -> tuple[Array, int]:
    """The driven motion at control instants, and evaluations of the plant on the way."""
    system = _CountingSystem(subject.plant)
    engine = NativeEngine(system, integrator, subject.control_period / substeps)
    q, v = split_state(tuple(subject.start.tolist()))
    states = [join_state(q, v)]
    try:
        for control in _commands(subject).tolist():
            motion = engine.advance(SCALAR, q, v, ((control, substeps),), None)
            q, v = motion.q, motion.v
            states.append(join_state(q, v))
    except ArithmeticError:
        pass
    missing = len(_commands(subject)) + 1 - len(states)
    return np.array(states + [(math.nan,) * len(states[0])] * missing), system.evaluations


class _CountingSystem(PlantSystem):
    """A system that counts how often it is asked for accelerations or a Jacobian."""

    evaluations = 0

    def rates(self, *arguments: Any) -> Any:
        self.evaluations += 1
        return super().rates(*arguments)

    def slopes(self, *arguments: Any) -> Any:
        given = super().slopes(*arguments)
        self.evaluations += given is not None
        return given


def _task(diagnosis: Diagnosis, subject: Subject, integrator: str) -> None:
    """Success of the hand-made controller at every step against the truth's."""
    for env_id in subject.environments:

        def share(integrator: str, dt: float, env_id: str = env_id) -> float | None:
            return metric(diagnosis, SECTION, env_id, integrator, dt, subject.control_period)

        truth = share(TRUTH, subject.control_period)
        if truth is None or integrator == TRUTH:
            continue
        shares = tuple(share(integrator, dt) or 0.0 for dt in subject.steps)
        diagnosis.add(
            SECTION, subject, integrator,
            f"success of the hand-made controller, {described(env_id)}", shares, "",
            f"{truth:.2f} ± {TOLERANCE:g}, as on the truth",
            all(abs(x - truth) <= TOLERANCE for x in shares), steps=subject.steps,
        )  # fmt: skip
