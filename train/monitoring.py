"""The gap between discretizations while a policy is trained."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from integ_gym.envs.settings import DISCRETIZATION, Discretization
from integ_gym.envs.testbeds.interface import Testbed
from integ_gym.envs.testbeds.making import find_testbed, make_checked
from integ_gym.support.optional import missing

from .called_policy import CalledPolicy
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
    testbed, cells = compared(env_id, home, others, environment or {})
    if episodes < 1:
        raise ValueError(f"`episodes` must be 1 or above, got {episodes}")
    found = {name: _played(policy, testbed, cell, episodes, seed) for name, cell in cells.items()}
    scores: dict[str, float] = {}
    for place, what in enumerate(("return", "success")):
        for name, values in found.items():
            scores[f"discretization/{what}/{_tag(name)}"] = values[place]
        elsewhere = [values[place] for name, values in found.items() if name != "home"]
        if elsewhere:
            scores[f"discretization/{what}_gap"] = found["home"][place] - min(elsewhere)
    return scores


def compared(
    env_id: str, home: Stated, others: Iterable[Stated], environment: Mapping[str, Any]
) -> tuple[Testbed, dict[str, Discretization]]:
    """The testbed and the discretizations of a gap, ``home`` first, each of which can be made.

    Raises:
        TypeError, ValueError: see :func:`discretization_gap`.
    """
    arguments = stated_arguments(home, env_id)
    if "integrator" not in arguments:
        raise ValueError("the gap is measured from a home; give home='integrator=…,dt=…'")
    _check_arguments(environment)
    own = {name: x for name, x in arguments.items() if name not in DISCRETIZATION}
    testbed = find_testbed(env_id, {**own, **environment})
    at_home = _discretization(arguments)
    chosen = [_beside(stated, at_home, env_id) for stated in others] or _default(testbed, at_home)
    cells = {"home": at_home, **{one.name: one for one in chosen if one != at_home}}
    for cell in cells.values():
        make_checked(testbed, cell, 1).close()
    return testbed, cells


def _check_arguments(environment: Mapping[str, Any]) -> None:
    varied = [name for name in environment if name in DISCRETIZATION]
    if varied:
        raise ValueError(
            f"`environment` gives `{varied[0]}`, which is what differs; name it in `home` or in "
            "`others`"
        )


def _discretization(arguments: Mapping[str, Any]) -> Discretization:
    return Discretization(**{name: arguments[name] for name in DISCRETIZATION})


def _beside(stated: Stated, home: Discretization, env_id: str) -> Discretization:
    """Another discretization, which has home's control period."""
    arguments = stated_arguments(stated, env_id)
    if "integrator" not in arguments:
        raise ValueError(
            f"`others` names discretizations, got {stated!r}; give 'integrator=…,dt=…'"
        )
    other = _discretization(arguments)
    return replace(other, control_period=home.control_period)


def _default(testbed: Testbed, home: Discretization) -> list[Discretization]:
    truth = testbed.truth(home.control_period)
    names = testbed.integrators(home.engine)
    return [
        *([] if truth is None else [truth]),
        *(replace(home, integrator=name) for name in names),
    ]


def _played(
    policy: Any, testbed: Testbed, cell: Discretization, episodes: int, seed: int
) -> tuple[float, float]:
    """Mean return and success over the starts."""
    environments = make_checked(testbed, cell, episodes, autoreset_mode=AutoresetMode.NEXT_STEP)
    asked = CalledPolicy(policy, environments.single_action_space, "policy")
    observation, _ = environments.reset(seed=list(range(seed, seed + episodes)))  # type: ignore[arg-type]
    running = np.ones(episodes, dtype=bool)
    returns, success = np.zeros(episodes), np.zeros(episodes)
    while running.any():
        actions = asked.act(observation)
        observation, reward, terminated, truncated, info = environments.step(
            actions.reshape(environments.action_space.shape)
        )
        returns[running] += reward[running]
        ended = running & (terminated | truncated)
        success[ended] = info["success"][ended]
        running &= ~ended
    environments.close()
    return float(returns.mean()), float(success.mean())


def _tag(name: str) -> str:
    """A cell's name as a part of a logger's."""
    return re.sub(r"[^A-Za-z0-9._]+", "-", name)


class RawModel:
    """A model as it is now, asked with raw observations.

    Args:
        model: of stable-baselines3, with the `VecNormalize` that it was trained with, if any.

    Raises:
        ValueError: for one that remembers earlier observations, which is asked one by one here.
    """

    def __init__(self, model: Any) -> None:
        if hasattr(model.policy, "lstm_actor"):
            raise ValueError(
                f"{type(model).__name__} remembers earlier observations, and is not judged; train "
                "a feed-forward policy, or give a function that keeps no memory"
            )
        self._model = model

    def predict(self, observations: Any, deterministic: bool = True) -> Any:
        """Actions of the model for a batch."""
        normalize = self._model.get_vec_normalize_env()
        seen = observations if normalize is None else normalize.normalize_obs(observations)
        return self._model.predict(seen, deterministic=deterministic)


try:
    from stable_baselines3.common.callbacks import BaseCallback
except ModuleNotFoundError as error:
    raise missing(str(error.name), "train") from error


class DiscretizationCallback(BaseCallback):
    """Evaluates the policy on a few other discretizations while it is trained.

    ``discretization/return_gap`` and its parts (see :func:`discretization_gap`) appear beside the
    return in the model's logger, TensorBoard among its outputs. Statistics of a `VecNormalize` are
    applied as they are at that moment.

    Args:
        every: environment steps between two evaluations.
        env_id: environment to evaluate in; by default that of the training, which must then be one
            of integ-gym's.
        home: what the policy is trained on; by default what the training environment says.
        others: to compare with; by default the truth and all integrators at home's step.
        episodes: starts of each evaluation, the same every time.
        environment: further constructor arguments; by default the training environment's.
        verbose: 1 prints the gap.

    Raises:
        TypeError, ValueError: when training begins, if the home is neither given nor told by the
            environment, or a discretization cannot be made; see :func:`discretization_gap`.
    """

    def __init__(
        self,
        every: int = 10_000,
        *,
        env_id: str | None = None,
        home: Stated = None,
        others: Iterable[Stated] = (),
        episodes: int = 10,
        environment: Mapping[str, Any] | None = None,
        verbose: int = 0,
    ) -> None:
        super().__init__(verbose)
        if every < 1 or episodes < 1:
            raise ValueError(f"`every` and `episodes` must be 1 or above, got {every}, {episodes}")
        self._every = every
        self._env_id, self._home, self._environment = env_id, home, environment
        self._others, self._episodes = tuple(others), episodes
        self._next = every

    def _on_training_start(self) -> None:
        self._next = self.num_timesteps + self._every
        known = self.training_env.has_attr("setup")
        if not known and (self._env_id is None or self._home is None):
            raise ValueError(
                "the training environment does not say its discretization; give "
                "DiscretizationCallback(env_id=..., home='integrator=…,dt=…'), or home='stock'"
            )
        if known:
            self._take_over(self.training_env.get_attr("setup"))
        compared(str(self._env_id), self._home, self._others, self._environment or {})

    def _take_over(self, setups: Sequence[Any]) -> None:
        """What was not given, from the training environments."""
        if self._home is None:
            homes = {Discretization.of(setup) for setup in setups}
            if len(homes) > 1:
                names = ", ".join(sorted(home.name for home in homes))
                raise ValueError(
                    f"the training environments differ ({names}), so none is home; give "
                    "DiscretizationCallback(home='integrator=…,dt=…')"
                )
            self._home = homes.pop()
        spec = self.training_env.get_attr("spec")[0]
        trained_in = spec.id if spec else None
        self._env_id = self._env_id or trained_in
        if self._environment is None and self._env_id == trained_in:
            told = setups[0].arguments()
            self._environment = {k: x for k, x in told.items() if k not in DISCRETIZATION}

    def _on_step(self) -> bool:
        if self.num_timesteps >= self._next:
            self._next = self.num_timesteps + self._every
            self._evaluate()
        return True

    def _evaluate(self) -> None:
        assert self._env_id is not None
        scores = discretization_gap(
            RawModel(self.model),
            self._env_id,
            self._home,
            others=self._others,
            episodes=self._episodes,
            environment=self._environment,
        )
        for name, value in scores.items():
            self.logger.record(name, value)
        self.logger.record("time/total_timesteps", self.num_timesteps, exclude="tensorboard")
        self.logger.dump(self.num_timesteps)
        if self.verbose:
            parts = ", ".join(f"{k.partition('/')[2]} {x:.3g}" for k, x in scores.items())
            print(f"{self.num_timesteps} steps: {parts}")
