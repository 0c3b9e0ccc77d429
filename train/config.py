"""What a training run is asked for, checked before it begins."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np

from integ_gym.envs.environment import OTHER_TESTBEDS
from integ_gym.envs.registries import ENVIRONMENTS, INTEGRATORS
from integ_gym.envs.settings import Mixture
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.vector_recorder import RecordVectorEvidence
from integ_gym.support.errors import InputError, InputTypeError, IntegGymError, is_raised_under
from integ_gym.support.parameters import check_values, nonnegative, unknown_name


class TrainingError(IntegGymError, RuntimeError):
    """A run that cannot go on, in one sentence with the remedy."""


@contextmanager
def translate_training_errors(config: TrainingConfig, mixture: Mixture) -> Iterator[None]:
    """Learning on a mixture, of which integrators of the user's own may fail.

    Raises:
        TrainingError: if one does, or if the weights are no longer finite.
    """
    try:
        yield
    except Exception as error:
        names = dict.fromkeys(setup.settings.integrator for setup in mixture.setups)
        own = (name for name in names if ":" in name)
        failed = [n for n in own if is_raised_under(INTEGRATORS.load(n), error)]
        if failed:
            raise TrainingError(
                f"the integrator {failed[0]!r} failed: {type(error).__name__}: {error}; "
                "docs/how-to/adding.md says what an integrator must be"
            ) from error
        if isinstance(error, IntegGymError) or not isinstance(error, ValueError):
            raise
        raise TrainingError(
            "training broke down: the policy's weights are no longer finite; lower "
            f"`learning_rate`={config.learning_rate:g}"
        ) from error


def whole(least: int, most: float = math.inf) -> Callable[[Any], str | None]:
    """A whole number of at least ``least`` and at most ``most``."""
    limits = f"{least} or above" if most == math.inf else f"from {least} to {most}"

    def check_whole(value: Any) -> str | None:
        fits = isinstance(value, int) and not isinstance(value, bool) and least <= value <= most
        return None if fits else f"must be a whole number, {limits}"

    return check_whole


def fraction(value: Any) -> str | None:
    """A number in [0, 1]."""
    return None if nonnegative(value) is None and value <= 1 else "must be a number from 0 to 1"


LONGEST = 10**12
"""Decisions of a training run, at most: at the trainers' speed, months of one core."""

MOST_LANES = 1 << 16
"""Environments that advance together, at most."""

LARGEST_ROLLOUT = 1 << 24
"""Decisions that are kept between two updates, at most: about a gigabyte."""

WIDEST, DEEPEST = 4096, 16
"""Units in a hidden layer, and hidden layers, at most."""


def layer_sizes(value: Any) -> str | None:
    """Sizes of layers."""
    fits = isinstance(value, tuple) and all(whole(1, WIDEST)(size) is None for size in value)
    if fits and len(value) <= DEEPEST:
        return None
    return f"must be a list of at most {DEEPEST} whole numbers, from 1 to {WIDEST}"


def named_values(value: Any) -> str | None:
    """A mapping from names."""
    fits = isinstance(value, Mapping) and all(isinstance(name, str) for name in value)
    return None if fits else "must map argument names to values"


ENV_ARGUMENTS = {
    "unit": "",
    "meaning": "constructor arguments, `mixture` among them; those left out take the environment's "
    "defaults",
    "check": named_values,
}
"""Of the hyperparameter that holds what the environment is made with."""


def check_rollout(n_envs: int, n_steps: int, batch_size: int) -> None:
    """Check that rollouts can be kept, and split into batches.

    Raises:
        ValueError: for an impossible value, in one sentence.
    """
    rollout = n_envs * n_steps
    if rollout > LARGEST_ROLLOUT:
        raise InputError(
            f"a rollout of `n_envs` × `n_steps` = {n_envs} × {n_steps} decisions is kept in "
            f"memory, and at most {LARGEST_ROLLOUT} are; give fewer"
        )
    if rollout % batch_size:
        divisors = (n for n in range(1, rollout + 1) if rollout % n == 0)
        nearest = min(divisors, key=lambda n: abs(math.log(n / batch_size)))
        raise InputError(
            f"`batch_size`={batch_size} does not divide a rollout of `n_envs` × `n_steps` "
            f"= {rollout} decisions; give a divisor, such as {nearest}"
        )


_GIVEN_BY_THE_TRAINER = ("num_envs", "vectorization_mode", "autoreset_mode", "render_mode")


@dataclass(frozen=True)
class TrainingConfig:
    """Hyperparameters that every algorithm has; each gives them defaults and adds its own.

    Raises:
        ValueError: for an impossible value, in one sentence.
    """

    algorithm: ClassVar[str]
    """As it is called: PPO, SAC."""
    environment_defaults: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Where an environment's defaults differ from those of the class."""
    continuous_actions: ClassVar[bool] = False
    """Whether it needs a `Box` of actions."""

    env_id: str
    env_arguments: dict[str, Any]
    seed: int
    total_steps: int
    n_envs: int
    learning_rate: float
    discount_time: float
    reward_scale: float
    net_arch: tuple[int, ...]
    trace_every: int

    def __post_init__(self) -> None:
        if isinstance(self.net_arch, list):
            object.__setattr__(self, "net_arch", tuple(self.net_arch))
        check_values(type(self), vars(self))
        known = (*ENVIRONMENTS, *gym.registry)
        if not (self.env_id in known or ":" in self.env_id):
            unknown = unknown_name("environment", self.env_id, ENVIRONMENTS)
            raise InputError(f"{unknown}, {OTHER_TESTBEDS}")
        for name in _GIVEN_BY_THE_TRAINER:
            if name in self.env_arguments:
                raise InputError(f"`{name}` is not an environment argument; leave it out")

    @classmethod
    def of(cls, env_id: str, **overrides: Any) -> Self:
        """The defaults that are known to learn an environment, with some values replaced.

        Raises:
            TypeError, ValueError: for unknown or impossible values.
        """
        known = [f.name for f in fields(cls)]
        for name in overrides:
            if name not in known:
                raise InputTypeError(unknown_name("hyperparameter", name, known))
        return cls(**{"env_id": env_id, **cls.environment_defaults.get(env_id, {}), **overrides})

    @classmethod
    def check_actions(cls, actions: gym.Space[Any]) -> None:
        """Check that the algorithm can learn an environment's actions.

        Raises:
            ValueError: for an action space that it cannot, with one that can.
        """
        if cls.continuous_actions and not isinstance(actions, gym.spaces.Box):
            raise InputError(f"{cls.algorithm} needs continuous actions, got {actions}; take PPO")

    @property
    def rollout(self) -> int:
        """Decisions between two updates, over all environments."""
        raise NotImplementedError

    @property
    def rounded_steps(self) -> int:
        """Decisions that the run will take: whole rollouts."""
        return math.ceil(self.total_steps / self.rollout) * self.rollout

    @property
    def first_lane_seed(self) -> int:
        """Seed of the first training environment; the others count up from it.

        Spread out, so that runs with neighbouring seeds do not share start states.
        """
        return int(np.random.SeedSequence(self.seed).generate_state(1)[0])

    def discount(self, control_period: float) -> float:
        """γ, the discount per decision, for a control period in s."""
        return math.exp(-control_period / self.discount_time)

    def derived(self, control_period: float) -> dict[str, Any]:
        """What follows from the hyperparameters, for a control period in s."""
        return {
            "gamma": self.discount(control_period),
            "rollout": self.rollout,
            "first_lane_seed": self.first_lane_seed,
        }


@dataclass(frozen=True)
class TrainingEvidence:
    """Where the training episodes of one policy are recorded, and what is said about them.

    Attributes:
        store: directory of an `EvidenceStore`.
        batch: name of the batch that holds them.
        context: what they are for; the fleet sets its float width and adds its packages.
    """

    store: Path
    batch: str
    context: EpisodeContext

    def recorder(self, vector_env: Any) -> Any:
        """Training environments that record; ``commit(batch)`` writes what they have recorded."""
        return RecordVectorEvidence(vector_env, self.store, self.context, commit_on_close=False)

    def discard(self) -> None:
        """Remove what a worker wrote that was lost before the run was finished."""
        (self.store / f"{self.batch}.parquet").unlink(missing_ok=True)
