"""The policy of a record, found again in the directory of its run."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from integ_gym.envs import environment_setup, testbed_of
from integ_gym.evidence import EvidenceRecord, EvidenceStore
from integ_gym.train import (
    BASELINES,
    POLICY_FILE,
    MlpPolicy,
    Policy,
    has_sidecar,
    make_baseline,
    read_observation_statistics,
    read_sb3_zip,
    read_trained,
)

from ..panel.existing.policy import STATISTICS_FILE


def policy_of(record: EvidenceRecord, store: EvidenceStore) -> Policy:
    """What acted in a record: a policy with its hash, from its run's ``policies`` or made again.

    Raises:
        PolicyFileError: for a policy that cannot be read.
        ValueError: if there is no policy of that hash, with the remedy.
    """
    name, wanted = record["policy_id"], record["policy_hash"]
    if not wanted:
        raise ValueError(
            "a record of training is of a policy that has changed since: it is shown on its own, "
            "if it has a trace; leave --on out, or give an evaluation record"
        )
    for folder in _folders(store.directory.parent / "policies"):
        if _told_hash(folder) in (wanted, None):
            policy = _read(folder)
            if policy.content_hash == wanted:
                return replace(policy, policy_id=name)
    if name in BASELINES:
        baseline = _baseline(name, record, store)
        if baseline.content_hash == wanted:
            return baseline
    raise ValueError(
        f"the policy {name} of this record is not in {store.directory.parent / 'policies'} and "
        "cannot be made again; restore its folder, or give a record with a trace without --on"
    )


def _folders(policies: Path) -> Iterator[Path]:
    return (path.parent for path in sorted(policies.glob(f"*/{POLICY_FILE}")))


def _told_hash(folder: Path) -> str | None:
    """The hash that a side-car tells; None where it must be computed."""
    if (folder / STATISTICS_FILE).exists() or not has_sidecar(folder / POLICY_FILE):
        return None
    with suppress(OSError, ValueError):
        return str(
            json.loads((folder / POLICY_FILE).with_suffix(".json").read_text()).get("content_hash")
        )
    return None


def _read(folder: Path) -> MlpPolicy:
    path, statistics = folder / POLICY_FILE, folder / STATISTICS_FILE
    if not has_sidecar(path):
        return read_sb3_zip(path, obs_stats=statistics if statistics.exists() else None)
    policy, _ = read_trained(path)
    if statistics.exists():
        return replace(policy, statistics=read_observation_statistics(statistics))
    return policy


def _baseline(name: str, record: EvidenceRecord, store: EvidenceStore) -> Policy:
    """A baseline for the undisturbed task, as its run made it."""
    found = store.query(
        "SELECT arguments FROM records WHERE phase = 'evaluation' AND perturbation IS NULL "
        "ORDER BY integrator <> 'reference' LIMIT 1"
    ).column("arguments")
    text = found[0].as_py() if len(found) else record["arguments"]
    arguments = {key: told["value"] for key, told in json.loads(text).items()}
    setup = environment_setup(record["env_id"], arguments)
    return make_baseline(name, setup, controller=testbed_of(record["env_id"], {}).controller)
