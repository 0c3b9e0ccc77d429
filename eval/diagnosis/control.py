"""Control: what of commands reaches the plant and when, and what finer steps change under it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import TRUTH
from integ_gym.envs.tasks.interface import FLOAT32_ROUNDING
from integ_gym.envs.transition import control_columns
from integ_gym.train.baselines import has_handmade, make_baseline

from ..verdict import EQUIVALENCE_MARGIN
from .bench import Commands, Rollout
from .lines import Diagnosis, Expectation, amount, near, undeclared
from .subject import Array, Subject, control_unit

LEVELS = (3.0, 0.6, -3.0, -0.6)
"""Commands in units of the actuator's limit, one after the other."""

HELD = 10
"""Decisions for which each is held, where all of them then take no more than two periods of the
slowest small oscillation: errors of longer motions say nothing of the order."""

AMPLITUDE = 0.5
"""Of the sine in which steps are refined, in units of the actuator's limit."""

HALF_PERIODS = (1, 2, 3)
"""Latencies whose timing is checked, in half control periods."""

PERIODS = (2, 4)
"""Latencies that the hand-made controller meets, in control periods."""

DECISIONS = 30
"""Of the motion whose commands are late."""

EPISODES = 20
"""Of the hand-made controller."""

DEMANDING = {"IntegPendulum-v0": {"start": "hanging", "max_torque": 0.8}}
"""Arguments that leave the controller little to spare, so that the discretization decides."""

_ROUNDING = 1e-9


def diagnose_actuation(diagnosis: Diagnosis) -> None:
    """Drive the plant from rest by commands within and beyond its limit."""
    subject, period = diagnosis.subject, diagnosis.subject.control_period
    limit = actuator_limit(subject)
    held = math.floor(4.0 * math.pi / subject.slowest / (len(LEVELS) * period))
    levels = _stagger(np.repeat(LEVELS, min(HELD, max(1, held))), subject)
    commands = limit * levels
    within = np.clip(commands, -limit, limit)
    truth = numerics.independent_motion(subject.plant, subject.rest, [*map(tuple, within)], period)
    for integrator in diagnosis.integrators:
        rollouts = diagnosis.follow(
            integrator, diagnosis.ladder(integrator), subject.rest, commands, "levels",
            duration=len(commands) * period, control_limit=limit,
        )  # fmt: skip
        own = {dt: rollouts[dt] for dt in diagnosis.steps(integrator)}
        _add_applied(diagnosis, integrator, commands, within, own)
        diagnosis.add_booked(integrator, rollouts, "work booked", "actuator_work", truth.work)
        diagnosis.add_ledger(integrator, rollouts)
        for env_id in subject.environments:
            _add_environment(diagnosis, integrator, env_id, levels)


def _stagger(values: Array, subject: Subject) -> Array:
    """Values (decisions,) for every control, each a decision after the one before it."""
    return np.stack([np.roll(values, k) for k in range(len(subject.plant.controls))], axis=1)


def _read_applied_controls(subject: Subject, rollout: Rollout) -> Array:
    """The control that acted in each decision of one lane, shape (decisions, controls)."""
    columns = [rollout.info[applied][1:, 0] for _, applied in control_columns(subject.plant)]
    return np.stack(columns, axis=1)


EFFORTS = {"actuator": "effort"}
"""Of an environment whose servos are a default: a diagnosis is of the plant."""


def actuator_limit(subject: Subject) -> float:
    """The largest limit of the plant's own environment, or 1 in the plant's unit."""
    if not subject.environments:
        return 1.0
    return max(environment_setup(subject.environments[0], EFFORTS).largest_controls)


def _add_applied(
    diagnosis: Diagnosis,
    integrator: str,
    commands: Array,
    within: Array,
    rollouts: Mapping[float, Rollout],
) -> None:
    """Every control that acted, and every count of saturation."""
    unit, steps = control_unit(diagnosis.subject.plant), tuple(rollouts)
    acted = [_read_applied_controls(diagnosis.subject, r) for r in rollouts.values()]
    off = [_largest(np.abs(x - within)) for x in acted]
    limit, most = (amount(float(x.max()), unit) for x in (within, commands))
    diagnosis.add(
        integrator,
        f"largest |control − command|, commands up to {most} cut to {limit}",
        off, unit, near(0.0, 0.0, off, unit), steps=steps,
    )  # fmt: skip
    counts = [float(np.nansum(r.info["saturated"][1:])) for r in rollouts.values()]
    lived = [int(np.isfinite(x).all(axis=1).sum()) for x in acted]
    wanted = [int((np.abs(commands[:n]) > within.max()).any(axis=1).sum()) for n in lived]
    expectation = Expectation(f"{wanted[-1]} of {lived[-1]}", "exactly", counts == wanted)
    diagnosis.add(
        integrator, "decisions counted as saturated", counts, "", expectation, steps=steps
    )


def _largest(values: Array) -> float:
    """Of the numbers that are some; NaN where none is."""
    numbers = values[np.isfinite(values)]
    return float(numbers.max()) if numbers.size else math.nan


def _add_environment(diagnosis: Diagnosis, integrator: str, env_id: str, levels: Array) -> None:
    """The same in an environment of the plant's own, with its own task."""
    setup = environment_setup(env_id, EFFORTS)
    if setup.task.discrete is not None:
        return
    subject, period = diagnosis.subject, diagnosis.subject.control_period
    low, high = np.array(setup.task.control_limits).T
    commands = low + (high - low) * 0.5 * (1.0 + levels)
    rollout = diagnosis.bench.task(
        f"{diagnosis.section}/{integrator}", env_id, Commands("levels", commands), 1,
        subject.rest[None], integrator=integrator, dt=period, control_period=period,
        duration=len(levels) * period, **EFFORTS,
    )  # fmt: skip
    control, counted = _read_applied_controls(subject, rollout), rollout.info["saturated"][1:, 0]
    lived = np.isfinite(control).all(axis=1)
    rounding = FLOAT32_ROUNDING * float(np.abs(high).max())
    off = (np.abs(control - np.clip(commands, low, high)) > rounding).any(axis=1)
    wrong = np.count_nonzero(lived & (off | (counted != (np.abs(levels) > 1.0).any(axis=1))))
    diagnosis.add(
        integrator, f"{env_id}, decisions with a wrong control or count of saturation",
        (float(wrong),), "",
        Expectation(
            f"0 of {lived.sum()}", f"{amount(rounding, control_unit(subject.plant))} off",
            bool(lived.any()) and wrong == 0,
        ),
        steps=(period,),
    )  # fmt: skip


def diagnose_refinement(diagnosis: Diagnosis) -> None:
    """The same commands, and the same controller, at ever smaller steps."""
    subject, plant = diagnosis.subject, diagnosis.subject.plant
    count = math.ceil(subject.period / subject.control_period)
    wave: Array = np.sin(2.0 * math.pi * np.arange(count) / count)
    commands = AMPLITUDE * actuator_limit(subject) * _stagger(wave, subject)
    duration = count * subject.control_period
    held = [*map(tuple, commands)]
    exact = numerics.independent_motion(plant, subject.start, held, subject.control_period)

    def drive(integrator: str) -> dict[float, Rollout]:
        steps = diagnosis.ladder(integrator)
        return diagnosis.follow(
            integrator, steps, subject.start, commands, "sine", duration=duration
        )

    truth = drive(TRUTH)
    states = truth[subject.control_period].state[:, 0]
    for integrator in dict.fromkeys((*diagnosis.integrators, TRUTH)):
        if integrator == TRUTH:
            _add_errors(diagnosis, integrator, truth, exact.states)
        else:
            _add_errors(diagnosis, integrator, drive(integrator), states)
    for env_id in subject.environments:
        cases = [(dt, 0.0) for dt in subject.steps]
        quantity = "success of the hand-made controller"
        add_success(diagnosis, env_id, quantity, cases[:1], cases, subject.steps)


def _add_errors(
    diagnosis: Diagnosis, integrator: str, rollouts: Mapping[float, Rollout], truth: Array
) -> None:
    """Largest errors of every coordinate at any control instant as line and curve, and the ledger.

    Of the truth there are no lines where it is not among the integrators that are asked about.
    """
    plant = diagnosis.subject.plant
    seconds = len(truth[1:]) * diagnosis.subject.control_period
    costs = np.array([(r.evaluations or 0) / seconds for r in rollouts.values()])
    for i, (name, unit) in enumerate(zip(plant.coordinates, plant.coordinate_units, strict=True)):
        wanted = truth[:, 2 * i]
        errors = {
            dt: float(np.abs(r.state[:, 0, 2 * i] - wanted).max()) for dt, r in rollouts.items()
        }
        if integrator in diagnosis.integrators:
            diagnosis.add_order(
                integrator, f"largest error of {name} in one driven period", errors, unit,
                max(1.0, float(np.abs(wanted).max())),
                exact="rounding, against SciPy", exactly=True,
            )  # fmt: skip
        diagnosis.draw(
            "refinement", integrator=integrator, coordinate=name, unit=unit,
            steps=np.array(list(errors)), errors=np.array(list(errors.values())),
            evaluations_per_second=costs, order=numerics.declared(integrator).order,
        )  # fmt: skip
    if integrator in diagnosis.integrators:
        diagnosis.add_ledger(integrator, rollouts)


def diagnose_latency(diagnosis: Diagnosis) -> None:
    """Delay commands, and compare with the same commands given later."""
    for integrator in diagnosis.integrators:
        _add_timing(diagnosis, integrator)
    period = diagnosis.subject.control_period
    late = [(period, k * period) for k in PERIODS]
    quantity = (
        f"success of the hand-made controller {', '.join(map(str, PERIODS))} control periods late"
    )
    for env_id in diagnosis.subject.environments:
        add_success(diagnosis, env_id, quantity, late, late, (period,))


def _add_timing(diagnosis: Diagnosis, integrator: str) -> None:
    """A delayed motion equals that under later commands; one like no delay at all is wrong."""
    subject = diagnosis.subject
    half = 0.5 * subject.control_period
    wave = np.sin(np.arange(1, DECISIONS + 1))
    commands = actuator_limit(subject) * _stagger(wave, subject)

    def states(name: str, values: Array, halves: int, latency: int) -> Array:
        """At control instants, shape (instants, n); times in halves of a control period."""
        rollout = diagnosis.bench.run_open_loop(
            f"{diagnosis.section}/{name}/{integrator}", subject, integrator, half,
            (name, values), subject.start[None],
            duration=DECISIONS * subject.control_period, control_period=halves * half,
            action_latency=latency * half,
        )  # fmt: skip
        return np.asarray(rollout.state[:, 0])

    at_once = states("at_once", commands, 2, 0)
    wrong, words, off = [], ("the same bit by bit", "exactly"), 0.0
    if integrator == TRUTH:
        words, off = ("the same to rounding", amount(numerics.ROUNDING)), numerics.ROUNDING
    for halves in HALF_PERIODS:
        delayed = states(f"delayed_{halves}", commands, 2, halves)
        waiting = np.zeros((halves, commands.shape[1]))
        later = np.concatenate([waiting, np.repeat(commands, 2, axis=0)])[: 2 * DECISIONS]
        shifted = states(f"shifted_{halves}", later, 1, 0)[::2]
        delays = different(delayed, at_once, off) > 0
        wrong.append(float(different(delayed, shifted, off) if delays else len(delayed)))
    diagnosis.add(
        integrator,
        f"instants of {DECISIONS + 1} at which delayed commands differ from later ones, by 1/2, 1, "
        "3/2 control periods",
        wrong, "", Expectation(f"0: {words[0]}", words[1], not any(wrong)),
        steps=(half,),
    )  # fmt: skip


def different(a: Array, b: Array, off: float) -> int:
    """Instants at which two motions of shape (instants, n) differ; two that ended do not.

    Args:
        a: one.
        b: the other.
        off: share of 1 + |value| up to which values are the same: the steps of the truth follow the
            errors of the ledger too, which begins anew at every decision.
    """
    same = np.isclose(a, b, rtol=off, atol=off, equal_nan=True)
    return int((~same).any(axis=1).sum())


def success(
    diagnosis: Diagnosis, env_id: str, integrator: str, dt: float, latency: float = 0.0
) -> float | None:
    """Share of episodes that succeed; None where the task has no hand-made controller.

    Args:
        diagnosis: where it is run.
        env_id: the environment.
        integrator: a registered name or ``"module:Class"``.
        dt: integration step, s.
        latency: of every command, s.
    """
    arguments: dict[str, Any] = {
        **DEMANDING.get(env_id, {}),
        "integrator": integrator,
        "dt": dt,
        "control_period": diagnosis.subject.control_period,
        "action_latency": latency,
    }
    setup = environment_setup(env_id, arguments)
    if not has_handmade(setup):
        return None
    cell = f"{diagnosis.section}/handmade/{integrator}/dt={dt:g}/latency={latency:g}"
    policy = make_baseline("handmade", setup)
    rollout = diagnosis.bench.task(cell, env_id, policy, EPISODES, **arguments)
    return float(rollout.success.mean())


def add_success(
    diagnosis: Diagnosis,
    env_id: str,
    quantity: str,
    truths: Sequence[tuple[float, float]],
    cases: Sequence[tuple[float, float]],
    steps: tuple[float, ...],
) -> None:
    """Add every integrator's success rates against the truth's, if there is a controller.

    Args:
        diagnosis: gets the lines.
        env_id: the environment.
        quantity: what succeeds, in words.
        truths: step and latency of the truth, s, one for each case or one for all.
        cases: step and latency of each rate, s.
        steps: integration steps that are named, s.
    """
    found = [success(diagnosis, env_id, TRUTH, *case) for case in truths]
    wanted = [rate for rate in found if rate is not None] * (len(cases) // len(truths))
    if not wanted:
        return
    rates = [f"{rate:.2f}" for rate in wanted]
    words = rates[0] if len(set(rates)) == 1 else ", ".join(rates)
    changed = ", ".join(f"{name}={value}" for name, value in DEMANDING.get(env_id, {}).items())
    quantity = f"{quantity}, {env_id}{f' ({changed})' if changed else ''}"
    for integrator in diagnosis.integrators:
        if integrator == TRUTH:
            continue
        shares = [success(diagnosis, env_id, integrator, *case) or 0.0 for case in cases]
        near_truth = EQUIVALENCE_MARGIN + _ROUNDING
        expectation = Expectation(
            f"{words}: as on the truth",
            f"±{EQUIVALENCE_MARGIN:g}",
            all(abs(a - b) <= near_truth for a, b in zip(wanted, shares, strict=True)),
        )
        if not any((*wanted, *shares)):
            expectation = undeclared("nothing: no success, not even on the truth")
        diagnosis.add(integrator, quantity, shares, "", expectation, steps=steps)
