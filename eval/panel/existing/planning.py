"""An evaluation planned: a panel without training around one policy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.train.baselines.making import possible_baselines

from ..cells import environments_of, main_home, standard_perturbations
from ..spec import PanelSpec
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
    environment = existing.provenance.environment
    testbed = find_testbed(env_id, environment)
    period, name = existing.provenance.control_period, existing.policy.policy_id
    own = () if existing.home is None else tuple(existing.home.shares)
    around = main_home(existing.home) or replace(testbed.home, control_period=period)
    engine = around.engine if integrators else testbed.home.engine
    columns = [
        Discretization(integrator, dt, period, engine)
        for integrator in integrators or testbed.integrators(engine)
        for dt in dts or testbed.steps(around)
    ]
    spec = PanelSpec(
        name=f"evaluate {name}",
        env_id=env_id,
        control_period=period,
        train=(),
        grid=tuple(dict.fromkeys([*columns, *own])),
        seeds=(),
        environment=environment,
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
