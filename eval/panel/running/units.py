"""Units of work of a panel: training runs, and evaluations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from integ_gym.train.baselines.making import make_baseline
from integ_gym.train.config import TrainingConfig
from integ_gym.train.policy import Policy
from integ_gym.train.policy_files.card import card_hash
from integ_gym.train.policy_files.sidecar import policy_file

from ..cells import Home, engine_versions, file_name, training_arguments
from ..spec import ALGORITHM, PanelSpec
from .run_directory import RunDirectory, key_of


@dataclass(frozen=True)
class Unit:
    """One training run with its evaluation, or the evaluation of one baseline.

    Attributes:
        row: name of the panel's row.
        home: training discretization or mixture, or None for a baseline.
        seed: training seed, or None.
    """

    row: str
    home: Home | None = None
    seed: int | None = None

    @property
    def policy(self) -> str:
        """Identifier of the policy, usable as a file name."""
        seed = "" if self.seed is None else f"-seed{self.seed}"
        return file_name(self.row) + seed

    @property
    def training(self) -> str:
        """Name of the training unit."""
        return f"train-{self.policy}"


def units_of(spec: PanelSpec) -> tuple[Unit, ...]:
    """Baselines first, which are quick, then the training runs, seed by seed."""
    return (*(Unit(name) for name in spec.baselines), *trained_units(spec))


def trained_units(spec: PanelSpec) -> tuple[Unit, ...]:
    """The training runs, seed by seed."""
    return tuple(
        Unit(home.name, home, seed)
        for seed in spec.seeds
        for home in spec.train
        if seed in spec.seeds_of(home)
    )


def baseline_of(spec: PanelSpec, name: str) -> Policy:
    """A baseline of a panel.

    Raises:
        ValueError: for one that cannot be made.
    """
    return make_baseline(name, spec.nominal, controller=spec.testbed.controller)


def training_config(spec: PanelSpec, unit: Unit) -> TrainingConfig:
    """Hyperparameters of one training run."""
    assert unit.home is not None
    told = {name: value for name, value in spec.training.items() if name != ALGORITHM}
    return spec.algorithm.config.of(
        spec.env_id,
        env_arguments=training_arguments(unit.home, spec.environment),
        seed=unit.seed,
        **told,
    )


def training_key(config: TrainingConfig) -> str:
    """Hash of all that a training run depends on."""
    arguments = config.env_arguments
    members = (arguments, *arguments.get("mixture", ()))
    engines = {member["engine"] for member in members if "engine" in member}
    return key_of(engine_versions(engines), config=asdict(config))


def is_trained(directory: RunDirectory, unit: Unit, key: str) -> bool:
    """Whether the unit's policy and its records are there.

    Raises:
        RunDirectoryError: if they are of another configuration or version.
    """
    policy = policy_file(directory.policies / unit.policy)
    return directory.finished(unit.training, key, policy) is not None


def is_there(spec: PanelSpec, directory: RunDirectory, unit: Unit) -> bool:
    """Whether the policy of a panel's unit and its records are there; see :func:`is_trained`."""
    return is_trained(directory, unit, training_key(training_config(spec, unit)))


def is_card_of(card: Mapping[str, Any], marker: Mapping[str, Any]) -> bool:
    """Whether a side-car is the one that a training unit ended with.

    Markers of before side-cars had a hash of themselves tell the policy's alone.
    """
    if marker.get("policy") != card.get("content_hash"):
        return False
    return "card" not in marker or marker["card"] == card_hash(card)
