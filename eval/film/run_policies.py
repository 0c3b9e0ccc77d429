"""The policy of a record, found again in the directory of its run."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from integ_gym.envs import environment_setup, testbed_of
from integ_gym.evidence import EvidenceRecord, EvidenceStore
from integ_gym.train import BASELINES, Policy, make_baseline

from ..panel.existing import read_policy_file

STATISTICS: Final = "obs_stats.*"
"""Statistics of observations that a run keeps beside a policy."""


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
    for folder in sorted((store.directory.parent / "policies").glob("*/")):
        policy = _read(folder) if _told_hash(folder) in (wanted, None) else None
        if policy is not None and policy.content_hash == wanted:
            found: Policy = replace(policy, policy_id=name)
            return found
    if name in BASELINES:
        baseline = _baseline(name, record, store)
        if baseline.content_hash == wanted:
            return baseline
    raise ValueError(
        f"the policy {name} of this record is not in {store.directory.parent / 'policies'} and "
        "cannot be made again; restore its folder, or give a record with a trace without --on"
    )


def _told_hash(folder: Path) -> str | None:
    """The hash that a side-car tells; None where it must be computed."""
    if next(folder.glob(STATISTICS), None) is not None:
        return None
    with suppress(OSError, ValueError):
        return str(json.loads((folder / "policy.json").read_text()).get("content_hash"))
    return None


def _read(folder: Path) -> Any:
    """The policy that a run keeps in a folder; None where it keeps none."""
    path = next((file for file in sorted(folder.glob("policy.*")) if file.suffix != ".json"), None)
    if path is None:
        return None
    return read_policy_file(path, next(folder.glob(STATISTICS), None))[0]


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
