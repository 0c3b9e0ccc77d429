"""The policy of a record, found again in the directory of its run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from integ_gym.envs.catalogue.lookup import environment_setup
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.evidence.record import EvidenceRecord
from integ_gym.evidence.replaying import Acting
from integ_gym.evidence.schema import argument_values
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError
from integ_gym.support.files import read_object
from integ_gym.train.baselines.making import BASELINES, make_baseline
from integ_gym.train.policy import Policy

from .policy import kept_policy, read_existing


def policy_of(record: EvidenceRecord, store: EvidenceStore, own_code: bool = False) -> Policy:
    """What acted in a record: a policy with its hash, from its run's ``policies`` or made again.

    Raises:
        PolicyFileError: for a policy that cannot be read.
        ValueError: if there is no policy of that hash, with the remedy.
    """
    name, wanted = record["policy_id"], record["policy_hash"]
    if not wanted:
        raise InputError(
            "a record of training is of a policy that has changed since, so it is not played "
            "again; give one that has a trace, without --on, or a record of an evaluation"
        )
    policies = store.directory.parent / "policies"
    for path, obs_stats in _files(policies, name):
        if _told_hash(path) in (wanted, None):
            found: Any = read_existing(path, record["env_id"], {}, obs_stats, own_code).policy
            if found.content_hash == wanted:
                named: Policy = replace(found, policy_id=name)
                return named
    if name in BASELINES:
        baseline = _baseline(name, record, store)
        if baseline.content_hash == wanted:
            return baseline
    raise InputError(
        f"the policy {name} of this record is not in {policies} and cannot be made again; restore "
        "its folder, or leave --on out for what has a trace"
    )


def acting_in(store: EvidenceStore, own_code: bool = False) -> Callable[[EvidenceRecord], Acting]:
    """What acted in the records of a run, each policy found once; see :func:`policy_of`."""
    found: dict[tuple[str, str], Acting] = {}

    def policy(record: EvidenceRecord) -> Acting:
        key = (record["policy_id"], record["policy_hash"])
        if key not in found:
            found[key] = policy_of(record, store, own_code).act
        return found[key]

    return policy


def _files(policies: Path, name: str) -> Iterator[tuple[Path, Path | None]]:
    """File and observation statistics of every policy of a run, that of a name first."""
    for folder in sorted(policies.glob("*/"), key=lambda own: (own.name != name, own.name)):
        kept = kept_policy(folder)
        if kept is not None:
            yield kept


def _told_hash(path: Path) -> str | None:
    """The hash that a side-car tells; None where it must be computed."""
    if any(path.parent.glob("obs_stats.*")):
        return None
    with suppress(ValueError):
        told = read_object(path.with_suffix(".json"), {"content_hash": str}, "")
        return str(told["content_hash"])
    return None


def _baseline(name: str, record: EvidenceRecord, store: EvidenceStore) -> Policy:
    """A baseline for the undisturbed task, as its run made it."""
    found = store.query(
        "SELECT arguments FROM records WHERE phase = 'evaluation' AND perturbation IS NULL "
        "ORDER BY integrator <> 'reference' LIMIT 1"
    ).column("arguments")
    text = found[0].as_py() if len(found) else record["arguments"]
    setup = environment_setup(record["env_id"], argument_values(text))
    return make_baseline(name, setup, controller=find_testbed(record["env_id"], {}).controller)
