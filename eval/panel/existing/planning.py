"""An evaluation planned: a panel without training around one policy's home."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from integ_gym.envs import Discretization, testbed_of
from integ_gym.train import possible_baselines

from ..specification import Home, PanelSpec, environments_of, standard_perturbations
from .policy import Existing


def plan(
    existing: Existing,
    env_id: str,
    integrators: Sequence[str] = (),
    dts: Sequence[float] = (),
    episodes: int = 50,
) -> PanelSpec:
    """The evaluation as a panel without training, all its cells checked.

    A baseline that cannot be made for the environment, such as a hand-made controller without
    gravity, is left out. The truth, where there is one, is always evaluated on.

    Args:
        existing: the policy.
        env_id: environment.
        integrators: names; by default all that the testbed offers but the truth.
        dts: steps, s; by default the testbed's.
        episodes: paired starts.

    Raises:
        TypeError, ValueError: for a cell that cannot be made.
    """
    testbed = testbed_of(env_id, existing.environment)
    home, name = main_home(existing.home), existing.policy.policy_id
    engine = home.engine if integrators else testbed.home.engine
    columns = [
        Discretization(integrator, dt, home.control_period, engine)
        for integrator in integrators or testbed.integrators(engine)
        for dt in dts or testbed.steps(home)
    ]
    spec = PanelSpec(
        name=f"evaluate {name}",
        env_id=env_id,
        control_period=home.control_period,
        train=(),
        grid=tuple(dict.fromkeys([*columns, *existing.home.shares])),
        seeds=(),
        environment=existing.environment,
        ladder=False,
        episodes=episodes,
        question=f"Does {name} survive another integrator or timestep?",
    )
    for cell in spec.columns():
        environments_of(testbed, cell, 1).close()
    return replace(
        spec,
        perturbations=standard_perturbations(spec.nominal),
        baselines=possible_baselines(spec.nominal, testbed.controller),
    )


def main_home(home: Home) -> Discretization:
    """The discretization that most of the training ran on, the first of equals."""
    return max(home.shares, key=lambda member: home.shares[member])
