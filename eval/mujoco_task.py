"""A Gymnasium MuJoCo task as a panel without training and without a truth column."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium as gym

from integ_gym.envs.discretization import DISCRETIZATION, Discretization
from integ_gym.envs.extras import load
from integ_gym.envs.rediscretized import RediscretizedEnv, mujoco_integrators, rediscretize
from integ_gym.envs.registration import ENVIRONMENTS
from integ_gym.envs.versions import package_version
from integ_gym.eval.cells import Cell, Home
from integ_gym.eval.existing.plan import REFINEMENTS, Grid
from integ_gym.eval.existing.policy import STATISTICS_FILE, Existing, load_policy
from integ_gym.eval.spec import PanelSpec
from integ_gym.train.box_baselines import BOX_BASELINES
from integ_gym.train.sidecar import POLICY_FILE

OWN = {"Pendulum-v1": "IntegPendulum-v0", "CartPole-v1": "IntegCartPole-v0"}
"""Gymnasium's environments that ours are at their defaults."""


@dataclass(frozen=True)
class TaskPanel(PanelSpec):
    """Cells of one MuJoCo task; see :func:`plan_task`."""

    success_return: float | None = None
    """An episode succeeds if its return reaches this; None: if it is not terminated."""
    reward_threshold: float | None = None
    """Return at which Gymnasium calls the task solved, where it says so."""

    def columns(self) -> tuple[Cell, ...]:
        """Cells that every row is evaluated in: the grid alone."""
        return tuple(Cell(discretization, "grid") for discretization in self.grid)

    def gaps(self) -> list[str]:
        """What every panel has and this one lacks, in sentences."""
        return [
            "A MuJoCo model with contacts has no reference solution: its cells are held against "
            "the home and against each other, not against the truth.",
            "There is no baseline 'handmade': of a task that is not our own, no controller is "
            "known.",
            "No perturbation of the plant is evaluated.",
            "No action latency is evaluated.",
        ]

    def to_json(self) -> dict[str, Any]:
        """The specification as plain data, with the version of the engine."""
        return {
            **super().to_json(),
            "success_return": self.success_return,
            "mujoco": package_version("mujoco"),
        }

    def environment_of(self, cell: Cell) -> RediscretizedEnv:
        """The task in one cell."""
        chosen = cell.discretization
        stock = stock_task(self.env_id, self.environment)
        return rediscretize(stock, chosen.integrator, chosen.dt, self.success_return)


def stock_task(env_id: str, arguments: Mapping[str, Any]) -> gym.Env[Any, Any]:
    """A MuJoCo task as Gymnasium makes it.

    Raises:
        ValueError: for an environment that Gymnasium cannot make or that is no MuJoCo task, or one
            without a time limit.
    """
    load("mujoco", "mujoco")
    load("imageio", "mujoco")
    from gymnasium.envs.mujoco import MujocoEnv

    wanted = f"--env takes {', '.join(ENVIRONMENTS)}, or a MuJoCo task such as Hopper-v5"
    try:
        env = gym.make(env_id, **arguments)
    except (gym.error.Error, TypeError, ValueError, OSError, ImportError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise ValueError(f"Gymnasium cannot make {env_id!r}: {reason}; {wanted}") from error
    if not isinstance(env.unwrapped, MujocoEnv):
        own = OWN.get(env_id)
        hint = f"; use --env {own}, which it is at its own discretization" if own else f"; {wanted}"
        raise ValueError(f"{env_id!r} is no MuJoCo task{hint}")
    if env.spec is None or env.spec.max_episode_steps is None:
        raise ValueError(
            f"{env_id!r} has no time limit, so its episodes may never end; register it with "
            "`max_episode_steps`"
        )
    return env


def read_for_task(
    path: Path, env_id: str, arguments: Mapping[str, Any], obs_stats: Path | None = None
) -> Existing:
    """A policy whose home is a stock MuJoCo task.

    Args:
        path: the zip that SB3 wrote.
        env_id: the task.
        arguments: of its ``gym.make``.
        obs_stats: JSON file of VecNormalize's statistics.

    Raises:
        ValueError: for a policy that was trained on another environment or whose spaces do not
            fit, or an argument that is what the evaluation varies.
    """
    for name in DISCRETIZATION:
        if name in arguments:
            raise ValueError(
                f"`{name}` is what the evaluation varies; leave it out of --env-arg and choose "
                "cells with --integrator and --dt"
            )
    with rediscretize(stock_task(env_id, arguments)) as env:
        home = Discretization.of(env.setup)
        spaces = env.observation_space, env.action_space
    policy, card = load_policy(path, obs_stats)
    if card is not None:
        trained = (card.get("config") or {}).get("env_id")
        raise ValueError(f"the policy was trained on {trained}; evaluate it with --env {trained}")
    policy.check_spaces(*spaces)
    files = {POLICY_FILE: path} | ({} if obs_stats is None else {STATISTICS_FILE: obs_stats})
    origin = "Gymnasium's own task, with its model's integrator and timestep"
    return Existing(policy, home, dict(arguments), origin, files)


def plan_task(
    existing: Existing, env_id: str, grid: Grid, success_return: float | None = None
) -> TaskPanel:
    """The evaluation as a panel, all its cells checked.

    Args:
        existing: the policy.
        env_id: the task.
        grid: what to evaluate on beside the home; by default all integrators of MuJoCo, at the
            task's timestep, half and a quarter of it.
        success_return: see :class:`TaskPanel`.

    Raises:
        ValueError: for an unknown integrator, or a timestep of which the control period is no whole
            multiple.
    """
    home = existing.home
    assert isinstance(home, Discretization)
    integrators = grid.integrators or mujoco_integrators()
    dts = grid.dts or [home.dt / n for n in REFINEMENTS]
    cells = [replace(home, integrator=i, dt=dt) for i in integrators for dt in dts]
    name = existing.policy.policy_id
    spec = TaskPanel(
        name=f"evaluate {name}",
        env_id=env_id,
        control_period=home.control_period,
        train=(),
        grid=tuple(dict.fromkeys([*cells, home])),
        seeds=(),
        environment=existing.environment,
        baselines=BOX_BASELINES,
        ladder=False,
        episodes=grid.episodes,
        episode_seed=grid.episode_seed,
        question=f"Does {name} survive another integrator or timestep of {env_id}?",
        success_return=success_return,
        reward_threshold=gym.spec(env_id).reward_threshold,
    )
    for cell in spec.columns():
        spec.environment_of(cell).close()
    return spec


def home_cell(home: Home) -> str:
    """Name of the stock task's cell."""
    assert isinstance(home, Discretization)
    return Cell(home, "grid").name
