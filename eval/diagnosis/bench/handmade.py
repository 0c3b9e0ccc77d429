"""Success of the hand-made controller on a registered environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from integ_gym.envs.catalogue.lookup import environment_setup
from integ_gym.envs.registries import TRUTH
from integ_gym.train.baselines.making import has_handmade, make_baseline

from ...verdict.rules import EQUIVALENCE_MARGIN
from ..lines.expectation import Expectation, undeclared
from ..section import Diagnosis

TOLERANCE = EQUIVALENCE_MARGIN
"""Success rates this near are the same."""

EPISODES = 20

DEMANDING = {"IntegPendulum-v0": {"start": "hanging", "max_torque": 0.8}}
"""Arguments that leave the controller little to spare, so that the discretization decides."""

_ROUNDING = 1e-9


def described(env_id: str) -> str:
    """The environment and what is not its default, in words."""
    more = DEMANDING.get(env_id, {})
    changed = ", ".join(f"{name}={value}" for name, value in more.items())
    return f"{env_id}{f' ({changed})' if changed else ''}"


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


def success_lines(
    diagnosis: Diagnosis,
    env_id: str,
    quantity: str,
    truths: Sequence[tuple[float, float]],
    cases: Sequence[tuple[float, float]],
    steps: tuple[float, ...],
) -> None:
    """Lines on every integrator's success rates against the truth's, if there is a controller.

    Args:
        diagnosis: gets the lines.
        env_id: the environment.
        quantity: what succeeds, in words.
        truths: step and latency of the truth, s, one for each case or one for all.
        cases: step and latency of each rate, s.
        steps: integration steps that are named, s.
    """
    wanted = [success(diagnosis, env_id, TRUTH, *case) for case in truths]
    if None in wanted:
        return
    rates = [rate or 0.0 for rate in wanted] * (len(cases) // len(wanted))
    said = list(dict.fromkeys(f"{rate:.2f}" for rate in rates))
    words = said[0] if len(said) == 1 else ", ".join(f"{rate:.2f}" for rate in rates)
    for integrator in diagnosis.integrators:
        if integrator == TRUTH:
            continue
        shares = [success(diagnosis, env_id, integrator, *case) or 0.0 for case in cases]
        expectation = Expectation(
            f"{words}: as on the truth",
            f"±{TOLERANCE:g}",
            all(abs(a - b) <= TOLERANCE + _ROUNDING for a, b in zip(rates, shares, strict=True)),
        )
        if not any((*rates, *shares)):
            expectation = undeclared("nothing: nobody succeeds, on the truth neither")
        diagnosis.add(
            integrator, f"{quantity}, {described(env_id)}", shares, "", expectation, steps=steps
        )
