"""Success of the hand-made controller on a registered environment."""

from __future__ import annotations

from typing import Any

from integ_gym.envs.registration import environment_setup
from integ_gym.eval.diagnosis.section import Diagnosis
from integ_gym.eval.verdict import EQUIVALENCE_MARGIN
from integ_gym.train.baselines import make_baseline

TOLERANCE = EQUIVALENCE_MARGIN
"""Success rates this near are the same."""

EPISODES = 20

DEMANDING = {"IntegPendulum-v0": {"start": "hanging", "max_torque": 0.8}}
"""Arguments that leave the controller little to spare, so that the discretization decides."""


def described(env_id: str) -> str:
    """The environment and what is not its default, in words."""
    more = DEMANDING.get(env_id, {})
    changed = ", ".join(f"{name}={value}" for name, value in more.items())
    return f"{env_id}{f' ({changed})' if changed else ''}"


def metric(
    diagnosis: Diagnosis,
    section: str,
    env_id: str,
    integrator: str,
    dt: float,
    control_period: float,
    latency: float = 0.0,
) -> float | None:
    """Share of episodes that succeed; None where the task has no hand-made controller.

    What was played once is not played again.

    Args:
        diagnosis: where it is run and remembered.
        section: what it is played for.
        env_id: the environment.
        integrator: a registered name or ``"module:Class"``.
        dt: integration step, s.
        control_period: s.
        latency: of every command, s.
    """
    key = (section, env_id, integrator, dt, control_period, latency)
    if key not in diagnosis.metrics:
        diagnosis.metrics[key] = _played(diagnosis, *key)
    return diagnosis.metrics[key]


def _played(
    diagnosis: Diagnosis,
    section: str,
    env_id: str,
    integrator: str,
    dt: float,
    control_period: float,
    latency: float,
) -> float | None:
    arguments: dict[str, Any] = {
        **DEMANDING.get(env_id, {}),
        "integrator": integrator,
        "dt": dt,
        "control_period": control_period,
        "action_latency": latency,
    }
    try:
        policy = make_baseline("handmade", environment_setup(env_id, arguments))
    except ValueError:
        return None
    cell = f"{section}/handmade/{integrator}/dt={dt:g}/latency={latency:g}"
    rollout = diagnosis.bench.task(cell, env_id, policy, EPISODES, **arguments)
    return float(rollout.success.mean())
