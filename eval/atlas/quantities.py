"""Dimensionless numbers of a discretization and a task, known before anything is trained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np

from integ_gym.envs import Discretization, numerics

from ..panel import Home, SpecError
from .limits import control_argument, critical_limit, middle_start, setup_of

UNREACHED = 1e3
"""Critical ratio of a discretization in which no limit suffices that was tried."""


@dataclass(frozen=True)
class Quantities:
    """What a policy's training ground does, beside what the truth does.

    Attributes:
        margin: limit of the control over the critical one of the truth.
        critical_ratio: critical limit there over that of the truth.
        energy_share: numerics' share of the energy that a greedy swing-up gains there; negative
            where they drain.
        force: of the numerics over the motor's full force, see :class:`numerics.Disturbance`.
        power: of the numerics over the motor's full power, the same.
        step: integration step over the control period.
        h_omega: integration step times the plant's fastest rate.
        inverse_order: one over the order of the method; 0 for the truth.
        growth: spectral radius of its map of the oscillator at h_omega, less 1.
    """

    margin: float
    critical_ratio: float
    energy_share: float
    force: float
    power: float
    step: float
    h_omega: float
    inverse_order: float
    growth: float


def quantities(env_id: str, environment: Mapping[str, Any], home: Home) -> Quantities:
    """The numbers of a task, and of what a policy is trained on.

    Those of a mixture are the means of its members', by their shares.

    Args:
        env_id: one of integ-gym's environments with a goal at rest.
        environment: constructor arguments without the discretization.
        home: discretization, or mixture.

    Raises:
        SpecError: where the task names no goal at rest, or the truth cannot reach it.
        TypeError, ValueError: for arguments that are not possible.
    """
    given = tuple(sorted(environment.items()))
    members = [(share, asdict(_of_one(env_id, given, one))) for one, share in home.shares.items()]
    means = {
        field.name: float(sum(share * one[field.name] for share, one in members))
        for field in fields(Quantities)
    }
    return Quantities(**means)


@lru_cache(maxsize=512)
def _of_one(env_id: str, given: tuple[tuple[str, Any], ...], home: Discretization) -> Quantities:
    environment = dict(given)
    truth_at = Discretization("reference", home.control_period, home.control_period)
    truth, there = (setup_of(env_id, environment, at) for at in (truth_at, home))
    argument, limit = control_argument(truth)
    critical = critical_limit(env_id, environment, argument, truth_at)
    try:
        own = critical_limit(env_id, environment, argument, home) / critical
    except SpecError:
        own = UNREACHED
    start, horizon = middle_start(truth)[None], truth.settings.duration
    required = numerics.goal_energy(truth)
    assert required is not None
    path = numerics.reach(truth, start, horizon, required)
    reached = numerics.reach(there, start, horizon, required)
    disturbed = numerics.disturbance(truth, there, path.states[:-1, 0], path.controls[:, 0])
    gained = required - numerics.energy_at(truth, start)[0]
    rate = numerics.fastest_rate(truth.plant)
    linear = numerics.linear_map(home.integrator, home.dt * rate)
    return Quantities(
        margin=limit / critical,
        critical_ratio=own,
        energy_share=float(np.clip(reached.residual[0] / gained, -1.0, 1.0)),
        force=disturbed.force,
        power=disturbed.power,
        step=home.dt / home.control_period,
        h_omega=home.dt * rate,
        inverse_order=_inverse_order(home.integrator),
        growth=linear.spectral_radius - 1.0,
    )


def _inverse_order(integrator: str) -> float:
    order = numerics.declared(integrator).order
    return 1.0 / order if order else 0.0
