"""A policy that exists already, with what is known of its training."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gymnasium import spaces

from integ_gym.train.baselines.making import BASELINES
from integ_gym.train.policy import Policy
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.onnx import OnnxPolicy, onnx_card, onnx_data
from integ_gym.train.policy_files.reading import (
    ONNX_ENDING,
    POLICY_ENDINGS,
    read_weights,
    unscaled,
)
from integ_gym.train.policy_files.sidecar import Stated, has_sidecar, read_trained, readable_file

from ..cells import Home
from .home import Provenance, provenance


@dataclass(frozen=True)
class Existing:
    """A policy and what is known of its training.

    Attributes:
        policy: what acts.
        provenance: where it comes from.
        files: what it was read from, by the name to keep it under.
        seed: of its training, where it is known.
        action_space: of the environment that it is judged in; None: not known.
        unscaled: whether it learned from scaled observations, and is given them as they are.
    """

    policy: Policy
    provenance: Provenance
    files: Mapping[str, Path]
    seed: int | None
    action_space: spaces.Space[Any] | None = None
    unscaled: bool = False

    @property
    def home(self) -> Home | None:
        """Discretization or mixture that it was trained on; None: unknown."""
        return self.provenance.home

    @property
    def told(self) -> dict[str, Any]:
        """What a panel's specification says of its home; null where that is unknown."""
        shares = {} if self.home is None else self.home.shares
        members = [one.arguments() for one in shares] or None
        told = {"discretizations": members, "origin": self.provenance.origin}
        return {**told, "shares": list(shares.values())} if len(shares) > 1 else told


def read_existing(
    path: Path,
    env_id: str,
    given: Mapping[str, Any],
    obs_stats: Path | None = None,
    own_code: bool = False,
    home: Stated = None,
) -> Existing:
    """A policy from its file, with what its side-car, the JSON file of the same name, says of it.

    Without a side-car, its home is what is stated, or unknown.

    Args:
        path: of its file.
        env_id: environment to evaluate in.
        given: environment arguments that override those of its training; not the discretization,
            which is what the evaluation varies.
        obs_stats: VecNormalize's statistics, as its pickle or as JSON.
        own_code: whether a class that the side-car names as ``"module:Class"`` may be loaded.
        home: what it was trained on.

    Raises:
        PolicyFileError: for a file that cannot be read, or a side-car of another policy.
        TypeError, ValueError: see :func:`~integ_gym.eval.panel.existing.home.provenance`.
    """
    read, card, files = read_policy_file(path, obs_stats)
    known, environments = provenance(env_id, card, home, given, own_code)
    space = environments.single_action_space
    policy = fitted(read, space)
    policy.check_spaces(environments.single_observation_space, space)
    name, seed = (path.stem, None)
    if card is not None:
        name, seed = str(card.get("policy_id", name)), card.get("seed")
    bare = obs_stats is None and unscaled(path, card)
    return Existing(replace(policy, policy_id=row_name(name)), known, files, seed, space, bare)


def read_policy_file(path: Path, obs_stats: Path | None = None) -> tuple[Any, Any, dict[str, Path]]:
    """The policy, what its side-car or metadata says, and the files by the name to keep them.

    Raises:
        PolicyFileError: for a file that cannot be read, or a side-car of another policy.
    """
    files = {f"policy{path.suffix.lower()}": path}
    if obs_stats is not None:
        files[f"obs_stats{obs_stats.suffix}"] = obs_stats
    card = None
    if path.suffix.lower() == ONNX_ENDING:
        card = onnx_card(path)
        files |= {data.name: data for data in onnx_data(path)}
    if not has_sidecar(path):
        return read_weights(path, None, obs_stats), card, files
    files["policy.json"] = path.with_suffix(".json")
    policy, told = read_trained(path)
    if card is not None and card.get("home") is not None and card["config"] != told.get("config"):
        raise PolicyFileError(
            f"{path}: its metadata and its side-car say different trainings; move the one away "
            "that is wrong"
        )
    return (policy if obs_stats is None else read_weights(path, told, obs_stats)), told, files


def kept_policy(folder: Path) -> tuple[Path, Path | None] | None:
    """File and observation statistics of a policy in its folder of a run; None without a file."""
    found = (readable_file(folder), *(folder / f"policy{ending}" for ending in POLICY_ENDINGS))
    file = next((path for path in found if path.exists()), None)
    return None if file is None else (file, next(folder.glob("obs_stats.*"), None))


def hashes_of(folder: Path) -> set[str]:
    """Hashes that the policy in a folder of a run can have in evidence; empty without a file.

    Whether its outputs are actions or values of actions is for the environment to say.

    Raises:
        PolicyFileError: see :func:`read_policy_file`.
    """
    kept = kept_policy(folder)
    if kept is None:
        return set()
    policy, _, _ = read_policy_file(*kept)
    acting = (fitted(policy, space) for space in (spaces.Box(-1.0, 1.0), spaces.Discrete(2)))
    return {one.content_hash for one in acting}


def fitted(policy: Any, action_space: spaces.Space[Any]) -> Any:
    """A graph's outputs are values of actions where the environment's actions are discrete."""
    if isinstance(policy, OnnxPolicy) and isinstance(action_space, spaces.Discrete):
        return replace(policy, discrete=True)
    return policy


def row_name(name: str) -> str:
    """A policy's name as that of its row and files, kept apart from the baselines'."""
    usable = re.sub(r"[^A-Za-z0-9._]+", "-", name).strip("-._")[:100] or "policy"
    return f"policy-{usable}" if usable in BASELINES else usable
