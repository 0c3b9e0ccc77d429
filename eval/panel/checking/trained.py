"""Training units of a run: their markers, side-cars and zips held against plan and records.

What a trainer says of a training follows from the plan, but for the machine and the time.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium import spaces

from integ_gym.envs.catalogue.lookup import is_integ_environment
from integ_gym.envs.settings import DISCRETIZATION, NATIVE, Mixture
from integ_gym.evidence.schema import Finding
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy_files.card import (
    LAST_EPISODES,
    episode_summary,
    make_card,
    mixture_of,
)
from integ_gym.train.policy_files.sb3_published import zip_faults
from integ_gym.train.policy_files.sidecar import POLICY_FILE, WEIGHTS_FILE

from ..cells import engine_versions
from ..running.run_directory import PACKAGES, key_of
from ..running.units import Unit, training_config
from ..spec import PanelSpec
from .setups import BASE, differing

_ELSEWHERE = ("card_hash", "content_hash", "format", "last_episodes", "platform", "versions")
"""What a side-car says that is checked in other ways, or not at all."""

_WRITERS = ("stable-baselines3", "torch", "jaxlib")
"""Packages whose versions a side-car may have where they decide no result."""

_EPISODES = """
SELECT policy_id, "return" AS returned, success FROM records WHERE phase = 'training'
ORDER BY policy_id, episode_index
"""

_SINGLE = 1e-5
"""Relative: trainers average returns in 32 bits."""


class Trained:
    """The training units of a run.

    Args:
        spec: that its plan describes.
        versions: of its manifest.
        store: its records.
        can_load: whether environments of the plan may be made here.
    """

    def __init__(
        self,
        spec: PanelSpec,
        versions: Mapping[str, str],
        store: EvidenceStore,
        can_load: bool,
    ) -> None:
        self._spec, self._versions, self._store = spec, versions, store
        engines = {home.engine for home in spec.trained_on()}
        self._can_make = can_load and engines <= {NATIVE}

    def faults(
        self, folder: Path, card: Mapping[str, Any], unit: Unit, marker: Mapping[str, Any]
    ) -> Iterator[Finding]:
        """What the files of a training unit say, and its plan and its records do not.

        Args:
            folder: of the policy.
            card: its side-car.
            unit: that trained it.
            marker: of that unit.
        """
        expected = self._card(unit, float(marker["seconds"])) | _of_files(folder)
        told = {name: x for name, x in card.items() if name not in _ELSEWHERE}
        if "units" not in expected:
            told = _common(told, expected)
        faults = [*differing("", told, expected), *self._of_versions(card)]
        faults += self._of_episodes(card, unit.policy)
        name = f"policies/{folder.name}"
        for place, recorded, wanted in faults:
            yield Finding(f"{name}/policy.json", None, _told(place, recorded, wanted))
        if (folder / POLICY_FILE).exists() and (folder / WEIGHTS_FILE).exists():
            for fault in zip_faults(folder / POLICY_FILE, folder / WEIGHTS_FILE):
                yield Finding(f"{name}/{POLICY_FILE}", None, fault)
        wanted = planned_key(
            self._versions,
            engine_versions({home.engine for home in unit.home.shares} if unit.home else ()),
            config=asdict(training_config(self._spec, unit)),
        )
        if marker["key"] != wanted:
            file = f"units/{unit.training}.json"
            yield Finding(file, None, _told("key", marker["key"], wanted))

    def _card(self, unit: Unit, seconds: float) -> dict[str, Any]:
        """A unit's side-car, or what of it follows where no environment can be made here."""
        spec = self._spec
        config: Any = training_config(spec, unit)
        made: dict[str, Any]
        if self._can_make and is_integ_environment(spec.env_id):
            mixture = self._mixture(config)
            made = make_card(config, mixture, spec.trainer, seconds, {})
            made["action_bounds"] = _bounds(mixture.setups[0].action_space)
            for member in filter(None, (made["discretization"], *(made["mixture"] or ()))):
                member["engine_version"] = self._versions["integ-gym"]
        else:
            made = {
                "algorithm": config.algorithm,
                "trainer": spec.trainer,
                "env_id": spec.env_id,
                "seed": unit.seed,
                "config": asdict(config),
                "steps": config.rounded_steps,
                "wall_seconds": seconds,
            }
            if "mixture" not in config.env_arguments:
                given = config.env_arguments
                made["discretization"] = {name: given[name] for name in DISCRETIZATION}
        for name in _ELSEWHERE:
            made.pop(name, None)
        plain: dict[str, Any] = json.loads(json.dumps(made))
        return plain

    def _mixture(self, config: Any) -> Mixture:
        env = gym.make_vec(
            config.env_id, 1, vectorization_mode="vector_entry_point", **config.env_arguments
        )
        try:
            return mixture_of(env)
        finally:
            env.close()

    def _of_versions(self, card: Mapping[str, Any]) -> Iterator[tuple[str, Any, Any]]:
        told = card.get("versions")
        if not isinstance(told, Mapping):
            yield "versions", told, dict(self._versions)
            return
        for name in sorted({*told, *BASE}):
            if name in self._versions or name not in _WRITERS:
                recorded, wanted = told.get(name), self._versions.get(name)
                if recorded != wanted:
                    yield f"versions.{name}", recorded, wanted

    def _of_episodes(self, card: Mapping[str, Any], policy: str) -> Iterator[tuple[str, Any, Any]]:
        """The last episodes of training: their number, and the means of what they came to."""
        last = self._episodes.get(policy, [])[-LAST_EPISODES:]
        returns = [x for x, _ in last if x is not None]
        successes = [float(x) for _, x in last if x is not None]
        if len(returns) < len(last):  # one was not finite
            return
        expected = {**episode_summary(returns, successes), "exploring": True}
        yield from differing("last_episodes", card.get("last_episodes"), expected, _SINGLE)

    @cached_property
    def _episodes(self) -> dict[str, list[tuple[float | None, bool | None]]]:
        found: dict[str, list[tuple[float | None, bool | None]]] = {}
        for row in self._store.query(_EPISODES).to_pylist():
            found.setdefault(row["policy_id"], []).append((row["returned"], row["success"]))
        return found


def planned_key(versions: Mapping[str, str], engines: Iterable[str], **parts: Any) -> str:
    """Key of a unit's inputs under the versions of its run's manifest.

    Args:
        versions: of the manifest.
        engines: packages of foreign engines that the unit depends on.
        parts: see :func:`integ_gym.eval.panel.running.run_directory.key_of`.
    """
    names = ("python", *PACKAGES, *engines)
    return key_of({name: versions.get(name, "missing") for name in names}, **parts)


def _of_files(folder: Path) -> dict[str, Any]:
    """What a side-car says of the files beside it."""
    file = folder / POLICY_FILE
    told = {
        "policy_file": POLICY_FILE if file.exists() else WEIGHTS_FILE,
        "weights_file": WEIGHTS_FILE,
    }
    if file.exists():
        told["zip_hash"] = hashlib.sha256(file.read_bytes()).hexdigest()
    return told


def _bounds(space: Any) -> Any:
    return [space.low.tolist(), space.high.tolist()] if isinstance(space, spaces.Box) else None


def _common(told: Any, expected: Any) -> Any:
    """What is told under keys that are expected."""
    if not (isinstance(told, Mapping) and isinstance(expected, Mapping)):
        return told
    return {name: _common(told.get(name), wanted) for name, wanted in expected.items()}


def _told(place: str, recorded: Any, wanted: Any) -> str:
    return f"`{place}` is recorded as {recorded!r:.80}, and planned as {wanted!r:.80}"
