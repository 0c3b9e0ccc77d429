"""Episodes of a run that `evidence verify` plays again, and what it says of them."""

from __future__ import annotations

import argparse
import random
from collections.abc import Callable
from functools import cache

from integ_gym.evidence.episodes.record import EvidenceRecord
from integ_gym.evidence.store.store import EvidenceStore
from integ_gym.evidence.verification.replaying import ELSEWHERE, Acting
from integ_gym.evidence.verification.sampling import replay_some
from integ_gym.support.terminal.formatting import plural


def replayed(
    store: EvidenceStore, given: argparse.Namespace, report: Callable[[int], object]
) -> tuple[list[str], list[str]]:
    """Deviations of what was played again, and sentences that say what was.

    Args:
        store: of the run.
        given: ``all``, ``sample``, ``seed``, ``exact``, ``own_code`` and ``policy`` of `verify`.
        report: told now and then how many more records are done with.
    """
    done = replay_some(
        store,
        None if given.all else max(0, given.sample),
        random.Random(given.seed),
        _policies(store, given.own_code),
        decide=given.policy,
        exact=given.exact,
        own_code=given.own_code,
        report=report,
    )
    count = store.count()
    told = [
        f"replayed: {done.records} of {plural(count, 'record')}, {done.exact} of them to the last "
        f"bit, the others within {ELSEWHERE:g}"
    ]
    if done.sensitive:
        told.append(
            f"sensitive: {plural(len(done.sensitive), 'record')} further off, by no more than "
            "rounding grows to: most numbers differ here, so another machine made them"
        )
    told += [f"not replayed: {plural(n, 'record')} {why}" for why, n in done.skipped.items() if n]
    left = count - done.records - sum(done.skipped.values())
    if left:
        told.append(f"not replayed: {plural(left, 'record')} not drawn, see --all")
    return list(map(str, done.findings)), told


def _policies(store: EvidenceStore, own_code: bool) -> Callable[[EvidenceRecord], Acting]:
    """What gives the policy of a record, loaded when it is first asked for."""

    @cache
    def found() -> Callable[[EvidenceRecord], Acting]:
        from integ_gym.eval.panel.existing.run_policies import acting_in

        return acting_in(store, own_code)

    return lambda record: found()(record)
