"""A policy that exists already, with what is known of its training."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from integ_gym.envs import DISCRETIZATION, Discretization, Mixture, make_training_environments
from integ_gym.train import (
    BASELINES,
    POLICY_FILE,
    SIDECAR_FILE,
    MlpPolicy,
    has_sidecar,
    read_observation_statistics,
    read_sb3_zip,
    read_trained,
)

from ..specification import DiscretizationMixture, Home

STOCK_ARGUMENTS: Mapping[str, Mapping[str, Any]] = {
    "IntegPendulum-v0": {"max_speed": 8.0},
    "IntegCartPole-v0": {},
}
"""What makes an environment Gymnasium's own at its default discretization."""

STATISTICS_FILE = "obs_stats.json"


@dataclass(frozen=True)
class Existing:
    """A policy and what is known of its training.

    Attributes:
        policy: what acts.
        home: discretization or mixture that it was trained on.
        environment: constructor arguments of its training environment, without the discretization.
        origin: where the two come from, in words.
        files: what it was read from, by the name to keep it under.
        seed: of its training, where it is known.
    """

    policy: MlpPolicy
    home: Home
    environment: Mapping[str, Any]
    origin: str
    files: Mapping[str, Path]
    seed: int | None


def read_existing(
    path: Path,
    env_id: str,
    given: Mapping[str, Any],
    obs_stats: Path | None = None,
    own_code: bool = False,
) -> Existing:
    """A policy from its file, with what its side-car, the JSON file of the same name, says of it.

    Without a side-car, the stock environment is what it was trained on.

    Args:
        path: the zip that SB3 wrote.
        env_id: environment to evaluate in.
        given: environment arguments that override those of its training; not the discretization,
            which is what the evaluation varies.
        obs_stats: JSON file of VecNormalize's statistics.
        own_code: whether a class that the side-car names as ``"module:Class"`` may be loaded.

    Raises:
        PolicyFileError: for a file that cannot be read, or a side-car of another policy.
        ValueError: if the side-car is damaged or of another environment, or names code that may
            not be run; or if ``given`` holds what the evaluation varies.
    """
    files, card = {POLICY_FILE: path}, None
    if obs_stats is not None:
        files[STATISTICS_FILE] = obs_stats
    if has_sidecar(path):
        files[SIDECAR_FILE] = path.with_suffix(".json")
        policy, card = read_trained(path)
        if obs_stats is not None:
            policy = replace(policy, statistics=read_observation_statistics(obs_stats))
    else:
        policy = read_sb3_zip(path, obs_stats=obs_stats)
    varied = (*DISCRETIZATION, "mixture")
    for name in varied:
        if name in given:
            raise ValueError(
                f"`{name}` is what the evaluation varies, and the policy's home comes from its "
                "side-car; leave it out of --env-arg and choose cells with --integrator and --dt"
            )
    if card is None:
        name, seed, arguments = path.stem, None, dict(STOCK_ARGUMENTS.get(env_id, {}))
        origin = "no side-car: Gymnasium's own environment is taken as its home"
    else:
        name, seed = str(card.get("policy_id", path.stem)), card.get("seed")
        arguments = _trained_on(card, env_id, own_code)
        origin = "the side-car beside the policy"
    arguments.update(given)
    environments = make_training_environments(env_id, arguments, 1)
    environments.close()
    policy.check_spaces(environments.single_observation_space, environments.single_action_space)
    return Existing(
        policy=replace(policy, policy_id=row_name(name)),
        home=_home(environments.mixture),
        environment={name: value for name, value in arguments.items() if name not in varied},
        origin=origin,
        files=files,
        seed=seed,
    )


def _trained_on(card: Mapping[str, Any], env_id: str, own_code: bool) -> dict[str, Any]:
    """Environment arguments of the training."""
    config = card.get("config")
    given = config.get("env_arguments") if isinstance(config, Mapping) else None
    if not isinstance(config, Mapping) or not isinstance(given, Mapping):
        raise ValueError(
            "the policy's side-car does not say what it was trained on; restore the file that the "
            "trainer wrote, or move it away to take Gymnasium's own environment as the home"
        )
    if config.get("env_id") != env_id:
        raise ValueError(
            f"the policy was trained on {config.get('env_id')}; evaluate it with --env "
            f"{config.get('env_id')}"
        )
    arguments = dict(given)
    foreign = [text for text in _texts(arguments) if ":" in text]
    if foreign and not own_code:
        raise ValueError(
            f"the policy's side-car names {foreign[0]!r}, whose code would be run; if it is yours, "
            "pass --own-code"
        )
    return arguments


def _texts(value: Any) -> list[str]:
    """All texts in plain data, keys left out."""
    if isinstance(value, str):
        return [value]
    inner = value.values() if isinstance(value, Mapping) else value
    return [t for x in inner for t in _texts(x)] if isinstance(inner, Iterable) else []


def _home(mixture: Mixture) -> Home:
    """What a training environment's episodes run on, a discretization named twice counted once."""
    weights: dict[Discretization, float] = {}
    for setup, share in zip(mixture.setups, mixture.shares, strict=True):
        member = Discretization.of(setup)
        weights[member] = weights.get(member, 0.0) + float(share)
    if len(weights) == 1:
        return next(iter(weights))
    return DiscretizationMixture("its mixture", tuple(weights.items()))


def row_name(name: str) -> str:
    """A policy's name as that of its row and files, kept apart from the baselines'."""
    usable = re.sub(r"[^A-Za-z0-9._]+", "-", name).strip("-._")[:100] or "policy"
    return f"policy-{usable}" if usable in BASELINES else usable
