"""An evaluation planned: a panel without training around one policy's home."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from integ_gym.envs.discretization import NATIVE, Discretization
from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.envs.registration import environment_setup
from integ_gym.eval.cells import Cell, Home, dividing_step
from integ_gym.eval.existing.policy import Existing
from integ_gym.eval.panel import nominal_setup
from integ_gym.eval.spec import PanelSpec
from integ_gym.eval.spec.perturbations import standard_perturbations
from integ_gym.train.baselines import possible_baselines

REFINEMENTS = (1, 2, 4)
"""Parts of the coarsest step that are evaluated where no steps are given."""


@dataclass(frozen=True)
class Grid:
    """The discretizations to evaluate on; the reference always comes with them.

    Attributes:
        integrators: names; by default all but the reference.
        dts: steps, s; by default the control period, half and a quarter of it.
        episodes: paired starts.
        episode_seed: seed of episode 0.
    """

    integrators: Sequence[str] = ()
    dts: Sequence[float] = ()
    episodes: int = 50
    episode_seed: int = 1000


def plan(existing: Existing, env_id: str, grid: Grid) -> PanelSpec:
    """The evaluation as a panel without training, all its cells checked.

    A baseline that cannot be made for the environment, such as a hand-made controller without
    gravity, is left out.

    Raises:
        TypeError, ValueError: for a cell that cannot be made.
    """
    spec = _specification(existing, env_id, grid)
    for cell in spec.columns():
        environment_setup(env_id, cell.arguments(spec.environment))
    return replace(spec, baselines=possible_baselines(nominal_setup(spec)))


def work(spec: PanelSpec, home: Home) -> int:
    """Cells that the evaluation runs, added up over the policy and the baselines."""
    return len(spec.cells_of(home)) + len(spec.baselines) * len(spec.cells_of(None))


def main_home(home: Home) -> Discretization:
    """The discretization that most of the training ran on, the first of equals."""
    return max(home.shares, key=lambda member: home.shares[member])


def _specification(existing: Existing, env_id: str, grid: Grid) -> PanelSpec:
    home = main_home(existing.home)
    period = home.control_period
    ours = [n for n in INTEGRATORS.names() if n != "reference"]
    integrators, engine = (grid.integrators, home.engine) if grid.integrators else (ours, NATIVE)
    coarsest = dividing_step({**existing.environment, "dt": period})
    dts = grid.dts or [coarsest / n for n in REFINEMENTS]
    columns = [Discretization(i, dt, period, engine) for i in integrators for dt in dts]
    return PanelSpec(
        name=f"evaluate {existing.policy.policy_id}",
        env_id=env_id,
        control_period=period,
        train=(),
        grid=tuple(dict.fromkeys([*columns, *existing.home.shares])),
        seeds=(),
        environment=existing.environment,
        perturbations=standard_perturbations(
            env_id, Cell(home, "grid").arguments(existing.environment)
        ),
        ladder=False,
        episodes=grid.episodes,
        episode_seed=grid.episode_seed,
        question=f"Does {existing.policy.policy_id} survive another integrator or timestep?",
    )
