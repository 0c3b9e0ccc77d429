"""A sample of a run's records, recomputed and played again before anything is built on them."""

from __future__ import annotations

import random
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from integ_gym.evidence.recomputing import recompute
from integ_gym.evidence.replaying import replay_some
from integ_gym.evidence.schema import Finding
from integ_gym.evidence.store import EvidenceStore

from ..existing.run_policies import acting_in
from ..running.run_directory import RunDirectory, RunDirectoryError
from .plan import EVALUATION, of_files

SAMPLED = 128
"""Records that are recomputed and played again before a page is written, of two files or more."""


def check_records(directory: RunDirectory) -> None:
    """Refuse records that no unit was finished with, or whose outcomes their traces deny.

    Of the latter a sample is recomputed and played again; `integ-gym evidence verify --all` does
    that with all.

    Raises:
        RunDirectoryError: with the first of them and the remedy.
    """
    refuse_first(directory.path, of_files(directory), of_sample(directory))


def refuse_first(path: Path, *findings: Iterator[Finding]) -> None:
    """Refuse a run if anything is found.

    Raises:
        RunDirectoryError: with the first finding and the remedy.
    """
    for finding in chain.from_iterable(findings):
        raise RunDirectoryError(
            f"{path / finding.file}: {finding.message}; restore it from a copy, or remove it and "
            "run the panel's command again, which does what is missing"
        )


def of_sample(directory: RunDirectory) -> Iterator[Finding]:
    """Outcomes that their traces deny, and episodes that environments and policies deny.

    Looked at are evaluation records that nobody can foretell.
    """
    store = EvidenceStore(directory.evidence)
    files = [file.name for file in store.files() if file.name.startswith(EVALUATION)]
    random.shuffle(files)
    left, most = SAMPLED, SAMPLED // min(2, max(1, len(files)))
    while files and left > 0:
        name = files.pop()
        records = store.some_records(name, most)
        left -= len(records)
        for record in records:
            yield from recompute(record, f"evidence/{name}")
        own, chance = store.only(name), random.Random()
        yield from replay_some(own, most, chance, acting_in(store)).findings
