"""The EvidenceRecord, version 1: every field that is not part of the trace.

This table and :mod:`integ_gym.evidence.trace_fields` are the definition of a record. The Arrow
schema, the JSON Schema, the content hash, the documentation and ``integ-gym evidence show`` all
derive from them.
"""

from __future__ import annotations

from dataclasses import dataclass

from integ_gym.envs.transition import DIVERGED, NOT_CONVERGED, NOT_REPORTED, OK, STATUS_NAMES

SCHEMA_VERSION = 1

PHASES = ("training", "evaluation")

LABELS = (
    "none",
    "evaluation_error",
    "discretization_error",
    "perception_error",
    "state_error",
    "control_error",
    "planning_error",
    "unattributed",
)

STATUS_CODES = {STATUS_NAMES[code]: code for code in (NOT_REPORTED, OK, NOT_CONVERGED, DIVERGED)}
"""Solver status to its code in the trace; a larger code is worse."""


@dataclass(frozen=True)
class Field:
    """One column of the evidence.

    Attributes:
        name: column name.
        kind: string, json (text that holds JSON), bool, int32, int64, float64, timestamp (UTC), or
            list<float64>, list<float32>, list<int32>, list<int8>.
        unit: SI unit; 1 for a dimensionless number, empty for what is no number.
        meaning: one line.
        group: heading under which it is shown; ``trace`` for trace columns.
        nullable: whether it may be null.
        volatile: whether the content hash leaves it out.
        frame: reference frame of a position, velocity, force or torque.
        choices: the values a string may have.
        at: ``instant`` (a value at every control instant) or ``step`` (a value for every control
            step); empty outside the trace.
        source: name of the row entry that a trace column is made of; see
            :class:`integ_gym.evidence.layout.Layout`.
    """

    name: str
    kind: str
    unit: str
    meaning: str
    group: str
    nullable: bool = False
    volatile: bool = False
    frame: str = ""
    choices: tuple[str, ...] = ()
    at: str = ""
    source: str = ""


def _text(
    group: str, name: str, meaning: str, *, kind: str = "string", nullable: bool = False,
    volatile: bool = False, choices: tuple[str, ...] = (),
) -> Field:  # fmt: skip
    return Field(name, kind, "", meaning, group, nullable, volatile, choices=choices)


def _flag(group: str, name: str, meaning: str) -> Field:
    return Field(name, "bool", "", meaning, group)


def _count(group: str, name: str, meaning: str, *, nullable: bool = False) -> Field:
    return Field(name, "int64", "1", meaning, group, nullable)


def _real(
    group: str, name: str, unit: str, meaning: str, *, nullable: bool = False,
    volatile: bool = False,
) -> Field:  # fmt: skip
    return Field(name, "float64", unit, meaning, group, nullable, volatile)


def _time(group: str, name: str, meaning: str) -> Field:
    return Field(name, "timestamp", "", meaning, group, volatile=True)


_IDENTITY = "identity"
_DISCRETIZATION = "discretization"
_POLICY = "policy"
_OUTCOME = "outcome"
_LEDGER = "ledger"
_SOLVER = "solver"
_PROVENANCE = "provenance"

SUMMARY_FIELDS: tuple[Field, ...] = (
    _text(_IDENTITY, "record_id", "hash of cell, policy and episode index"),
    _count(_IDENTITY, "schema_version", "version of this table"),
    _text(_IDENTITY, "run_id", "the run that the record belongs to"),
    _text(_IDENTITY, "phase", "what the episode was for", choices=PHASES),
    _text(_IDENTITY, "env_id", "Gymnasium id of the environment"),
    _text(_IDENTITY, "cell", "key of the panel cell or training run"),
    _count(_IDENTITY, "episode_index", "number of the episode in its cell, from 0"),
    _count(
        _IDENTITY,
        "seed",
        "seed given at the reset that seeded the generator; null if none was, or beyond 64 bits",
        nullable=True,
    ),
    _text(
        _IDENTITY,
        "rng_key",
        "`entropy/n`: what seeded the generator, and how many episodes it had started before",
    ),
    Field(
        "initial_state",
        "list<float64>",
        "SI",
        "true state at time 0, in state order",
        _IDENTITY,
        frame="plant",
    ),
    _text(_DISCRETIZATION, "engine", "what advanced the plant"),
    _text(_DISCRETIZATION, "engine_version", "version of the engine"),
    _text(
        _DISCRETIZATION,
        "engine_description",
        "the engine's float width, map, fingerprint and stops; `resistance`, where the force of "
        "our stops and friction acts; why no constraint is violated",
        kind="json",
    ),
    _text(_DISCRETIZATION, "integrator", "one-step map, as the engine calls it"),
    _real(_DISCRETIZATION, "dt", "s", "integration step"),
    _real(_DISCRETIZATION, "control_period", "s", "time between two decisions"),
    _count(_DISCRETIZATION, "substeps", "integration steps per decision"),
    _real(_DISCRETIZATION, "sensor_period", "s", "time between two sensor samples"),
    _real(_DISCRETIZATION, "action_latency", "s", "delay of every command"),
    _real(_DISCRETIZATION, "observation_noise", "SI", "standard deviation of the sensor noise"),
    _real(
        _DISCRETIZATION,
        "solver_tolerance",
        "1",
        "scaled residual beyond which a solution is not converged; null: no solver",
        nullable=True,
    ),
    _count(
        _DISCRETIZATION,
        "solver_cap",
        "most solver iterations per integration step; null: no solver",
        nullable=True,
    ),
    _real(_DISCRETIZATION, "duration", "s", "time until truncation"),
    _text(_DISCRETIZATION, "fallback", "control where no valid command acted"),
    _real(
        _DISCRETIZATION,
        "max_speed",
        "SI",
        "clip on every velocity; null: no clip",
        nullable=True,
    ),
    _text(_DISCRETIZATION, "start", "start distribution"),
    _text(
        _DISCRETIZATION,
        "arguments",
        "all constructor arguments and plant parameters: name to value and unit",
        kind="json",
    ),
    _text(_POLICY, "policy_id", "name of the policy"),
    _text(_POLICY, "policy_hash", "hash of what decides its actions; empty in training"),
    _text(
        _POLICY,
        "training_discretization",
        "what the policy was trained on; null: not trained",
        kind="json",
        nullable=True,
    ),
    _count(_POLICY, "training_seed", "seed of its training; null: not trained", nullable=True),
    _text(
        _POLICY,
        "perturbation",
        "plant parameters changed in this cell; null: none",
        kind="json",
        nullable=True,
    ),
    _text(_OUTCOME, "metric", "name of the metric"),
    _text(_OUTCOME, "metric_definition", "what counts as success, with units"),
    _real(_OUTCOME, "return", "1", "sum of rewards; null if not finite", nullable=True),
    _flag(_OUTCOME, "success", "whether the metric was met"),
    _real(
        _OUTCOME,
        "time_to_success",
        "s",
        "start of the final unbroken stay at the goal; null without success",
        nullable=True,
    ),
    _count(_OUTCOME, "length", "control steps"),
    _flag(_OUTCOME, "terminated", "ended by the task or by a divergence"),
    _flag(_OUTCOME, "truncated", "ended by the time limit"),
    _real(_OUTCOME, "saturated_share", "1", "share of control steps whose action was saturated"),
    _count(_OUTCOME, "fallback_count", "control steps in which the fallback acted"),
    _count(_OUTCOME, "recovery_count", "control steps without fallback right after one with"),
    _real(
        _OUTCOME,
        "penetration_max",
        "m, rad",
        "deepest penetration of a stop; null: not reported",
        nullable=True,
    ),
    _real(
        _OUTCOME,
        "constraint_violation_max",
        "m",
        "largest constraint violation; null: not reported, or none to violate",
        nullable=True,
    ),
    _text(_OUTCOME, "failure_label", "first failure rule that fits", choices=LABELS),
    _text(_OUTCOME, "failure_reason", "why, in a sentence with numbers"),
    _real(_LEDGER, "energy_start", "J", "energy at time 0; zero at rest hanging"),
    _real(_LEDGER, "energy_end", "J", "energy at the end"),
    _real(_LEDGER, "work_total", "J", "work of the actuator"),
    _real(
        _LEDGER,
        "dissipated_total",
        "J",
        "energy that damping took out; null: a loss is not known",
        nullable=True,
    ),
    _real(
        _LEDGER,
        "contact_loss_total",
        "J",
        "energy that contact took out; null: not reported",
        nullable=True,
    ),
    _real(_LEDGER, "clip_loss_total", "J", "energy that the speed limit took out"),
    _real(
        _LEDGER,
        "energy_residual_total",
        "J",
        "energy that numerical error put in; null: a loss is not known",
        nullable=True,
    ),
    _real(
        _LEDGER,
        "energy_residual_abs_total",
        "J",
        "sum of the residual's magnitude per step; null: a loss is not known",
        nullable=True,
    ),
    _count(_SOLVER, "solver_iterations_max", "most iterations in one integration step"),
    _real(
        _SOLVER,
        "solver_iterations_mean",
        "1",
        "mean over control steps of the most iterations in one integration step",
    ),
    _text(_SOLVER, "solver_status", "worst status of any control step", choices=STATUS_NAMES),
    _count(_PROVENANCE, "trace_every", "every n-th episode of its cell has a trace"),
    _count(_PROVENANCE, "float_width", "bits of the numbers that the physics was computed with"),
    _text(_PROVENANCE, "package_versions", "versions of the packages that matter", kind="json"),
    _text(_PROVENANCE, "platform", "operating system and processor", volatile=True),
    _real(
        _PROVENANCE,
        "inference_latency_mean",
        "ns",
        "mean time of one decision at batch size 1; null: not measured",
        nullable=True,
        volatile=True,
    ),
    _real(
        _PROVENANCE,
        "inference_latency_p99",
        "ns",
        "99th percentile of the same; null: not measured",
        nullable=True,
        volatile=True,
    ),
    _real(_PROVENANCE, "latency_budget", "s", "time there is for a decision: the control period"),
    _time(_PROVENANCE, "wall_start", "when the episode began"),
    _time(_PROVENANCE, "wall_end", "when the episode ended"),
    _text(
        _PROVENANCE,
        "content_hash",
        "SHA-256 over everything but the volatile fields",
        volatile=True,
    ),
)

VOLATILE_NAMES = frozenset(field.name for field in SUMMARY_FIELDS if field.volatile)
"""Wall clock, latencies, host, and the content hash itself."""
