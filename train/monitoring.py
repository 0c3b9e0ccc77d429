"""The gap between discretizations while a policy is trained."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from integ_gym.envs.settings import DISCRETIZATION, Discretization
from integ_gym.envs.testbeds.gym_testbed import Testbed
from integ_gym.envs.testbeds.making import find_testbed, make_checked
from integ_gym.support.errors import InputError

from .policy import CalledPolicy
from .policy_files.sidecar import Stated, stated_arguments

FIRST_SEED = 50_000
"""Seed of the first start."""


def discretization_gap(
    policy: Any,
    env_id: str,
    home: Stated,
    *,
    others: Iterable[Stated] = (),
    episodes: int = 10,
    environment: Mapping[str, Any] | None = None,
    seed: int = FIRST_SEED,
) -> dict[str, float]:
    """Mean return and success of a policy at home and on other discretizations, and the gap.

    All discretizations have home's control period and the same starts.

    Args:
        policy: anything callable, from one observation to one action, or anything with
            ``predict``; its action must be the deterministic one.
        env_id: one of integ-gym's environments, or a MuJoCo task of Gymnasium's.
        home: what it is trained on: ``"integrator=…,dt=…,control_period=…"``, the same as a
            mapping or a `Discretization`, or ``"stock"``.
        others: to compare with, each as ``home``; by default the truth, where there is one, and
            all integrators at home's step.
        episodes: starts.
        environment: further constructor arguments of the training environment.
        seed: of the first start.

    Returns:
        By name, ready for a logger: ``discretization/return/NAME`` and
        ``discretization/success/NAME`` of each, ``home`` among the names, then
        ``discretization/return_gap`` and ``discretization/success_gap``: home's minus the lowest
        elsewhere, positive where the policy does worse elsewhere.

    Raises:
        TypeError, ValueError: for a home that is none, a cell that cannot be made, or a policy that
            gives no such actions.
    """
    testbed, cells = comparison_cells(env_id, home, others, environment or {})
    if episodes < 1:
        raise InputError(f"`episodes` must be 1 or above, got {episodes}")
    found = {name: _play(policy, testbed, cell, episodes, seed) for name, cell in cells.items()}
    scores: dict[str, float] = {}
    for place, what in enumerate(("return", "success")):
        for name, values in found.items():
            tag = re.sub(r"[^A-Za-z0-9._]+", "-", name)
            scores[f"discretization/{what}/{tag}"] = values[place]
        elsewhere = [values[place] for name, values in found.items() if name != "home"]
        if elsewhere:
            scores[f"discretization/{what}_gap"] = found["home"][place] - min(elsewhere)
    return scores


def send_to_trackers(scores: Mapping[str, float], step: int) -> None:
    """Log to the run of Weights & Biases and of MLflow that this process has open, if any.

    Neither is imported here: a process that has a run open has imported it.

    Args:
        scores: by name.
        step: environment steps so far.
    """
    wandb, mlflow = (sys.modules.get(name) for name in ("wandb", "mlflow"))
    if wandb is not None and wandb.run is not None:
        wandb.log({**scores, "global_step": step})
    if mlflow is not None and mlflow.active_run() is not None:
        mlflow.log_metrics(dict(scores), step=step)


def comparison_cells(
    env_id: str, home: Stated, others: Iterable[Stated], environment: Mapping[str, Any]
) -> tuple[Testbed, dict[str, Discretization]]:
    """The testbed and the discretizations of a gap, ``home`` first, each of which can be made.

    Raises:
        TypeError, ValueError: see :func:`discretization_gap`.
    """
    arguments = stated_arguments(home, env_id, environment)
    if "integrator" not in arguments:
        raise InputError("the gap is measured from a home; give home='integrator=…,dt=…'")
    varied = [name for name in environment if name in DISCRETIZATION]
    if varied:
        raise InputError(
            f"`environment` gives `{varied[0]}`, which is what differs; name it in `home` or in "
            "`others`"
        )
    own = {name: x for name, x in arguments.items() if name not in DISCRETIZATION}
    testbed = find_testbed(env_id, {**own, **environment})
    at_home = _discretization(arguments)
    chosen = []
    for stated in others:
        other = stated_arguments(stated, env_id, environment)
        if "integrator" not in other:
            raise InputError(
                f"`others` names discretizations, got {stated!r}; give 'integrator=…,dt=…'"
            )
        chosen.append(replace(_discretization(other), control_period=at_home.control_period))
    if not chosen:
        truth = testbed.truth(at_home.control_period)
        names = testbed.integrators(at_home.engine)
        chosen = [
            *([] if truth is None else [truth]),
            *(replace(at_home, integrator=name) for name in names),
        ]
    cells = {"home": at_home, **{one.name: one for one in chosen if one != at_home}}
    for cell in cells.values():
        make_checked(testbed, cell, 1).close()
    return testbed, cells


def _discretization(arguments: Mapping[str, Any]) -> Discretization:
    return Discretization(**{name: arguments[name] for name in DISCRETIZATION})


def _play(
    policy: Any, testbed: Testbed, cell: Discretization, episodes: int, seed: int
) -> tuple[float, float]:
    """Mean return and success over the starts."""
    environments = make_checked(testbed, cell, episodes, autoreset_mode=AutoresetMode.NEXT_STEP)
    act = CalledPolicy(policy, environments.single_action_space, "policy").begin()
    observation, _ = environments.reset(seed=list(range(seed, seed + episodes)))  # type: ignore[arg-type]
    running = np.ones(episodes, dtype=bool)
    returns, success = np.zeros(episodes), np.zeros(episodes)
    while running.any():
        actions = act(observation)
        observation, reward, terminated, truncated, info = environments.step(
            actions.reshape(environments.action_space.shape)
        )
        returns[running] += reward[running]
        ended = running & (terminated | truncated)
        success[ended] = info["success"][ended]
        running &= ~ended
    environments.close()
    return float(returns.mean()), float(success.mean())


class RawModel:
    """A model as it is now, asked with raw observations.

    Args:
        model: of stable-baselines3, with the `VecNormalize` that it was trained with, if any.
    """

    def __init__(self, model: Any) -> None:
        self._model = model

    def predict(self, observations: Any, state: Any = None, deterministic: bool = True) -> Any:
        """Actions of the model for a batch, and the state of one that remembers."""
        normalize = self._model.get_vec_normalize_env()
        seen = observations if normalize is None else normalize.normalize_obs(observations)
        return self._model.predict(seen, state=state, deterministic=deterministic)
