"""Doubts about the rewards of a task whose testbed does not say what they are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from integ_gym.envs.foreign import ASSUMED_RATE
from integ_gym.evidence.store import EvidenceStore

_SAY_IT = (
    "does not say what its rewards are, so that a decision pays their mean, and of an episode's "
    'last step the whole; give `held` rewards="rate", "sum" or "last"'
)

_ASSUMED = f"phase = 'evaluation' AND engine_description LIKE '%{ASSUMED_RATE}%'"

_REPEATED = f"SELECT record_id FROM records WHERE {_ASSUMED} AND substeps > 1 LIMIT 1"

_LAST = f"""
SELECT * FROM (
    SELECT reward[length] AS last, list_min(reward[:length - 1]) AS least,
        list_max(reward[:length - 1]) AS most
    FROM records
    WHERE {_ASSUMED} AND terminated AND reward IS NOT NULL AND length > 1
)
WHERE abs(last) > 2.0 * greatest(abs(least), abs(most))
    OR (last < 0.0 AND least > 0.0) OR (last > 0.0 AND most < 0.0)
ORDER BY abs(last) DESC LIMIT 1
"""
"""The reward with which an episode ended that is most unlike those before it, if there is one."""

_PAID = f"""
SELECT policy_id, engine, integrator, dt,
    sum(list_sum(reward[:length - 1])) / sum(length - 1) AS paid
FROM records
WHERE {_ASSUMED} AND perturbation IS NULL AND reward IS NOT NULL AND length > 1
GROUP BY ALL
"""
"""Mean reward of a decision, the last of each episode left out."""

_CLOSE = 0.2
"""How far, relatively, rewards may be from being proportional to the step."""


def reward_doubts(env_id: str, records: EvidenceStore) -> tuple[str, ...]:
    """A doubt where rewards were taken for rates because the testbed does not say what they are.

    Two things speak against it: a step that ends an episode pays what is of another kind than all
    before it (more than twice as large, or of the other sign), and rewards that shrink in
    proportion to the step.

    Args:
        env_id: of the testbed.
        records: of a panel.
    """
    if not records.query(_REPEATED).num_rows:
        return ()
    found = [*_unlike_the_others(records), *_proportional_to_the_step(records)]
    return (f"{'; '.join(found)}; and {env_id} {_SAY_IT}",) if found else ()


def _unlike_the_others(records: EvidenceStore) -> Iterator[str]:
    for row in records.query(_LAST).to_pylist():
        least, most = f"{row['least']:.3g}", f"{row['most']:.3g}"
        others = least if least == most else f"{least} to {most}"
        yield (
            f"the reward of the decision that ends an episode ({row['last']:.3g}) is of another "
            f"kind than those before it ({others})"
        )


def _proportional_to_the_step(records: EvidenceStore) -> Iterator[str]:
    """One sentence, if every policy's rewards shrink as the step does."""
    paid: dict[tuple[Any, ...], dict[float, float]] = {}
    for row in records.query(_PAID).to_pylist():
        paid.setdefault((row["policy_id"], row["engine"], row["integrator"]), {})[row["dt"]] = row[
            "paid"
        ]
    found = []
    for (policy, *_), by_step in sorted(paid.items()):
        fine, coarse = min(by_step), max(by_step)
        if fine < coarse and by_step[coarse]:
            ratio = by_step[fine] / by_step[coarse] * coarse / fine
            found.append((abs(ratio - 1.0), policy, fine, coarse, by_step))
    if not found or max(off for off, *_ in found) > _CLOSE:
        return
    _, policy, fine, coarse, by_step = found[0]
    yield (
        f"rewards shrink with `dt` as amounts do that are scaled by it: a decision of {policy} "
        f"earns {by_step[coarse]:.3g} at dt {coarse:g} s and {by_step[fine]:.3g} at dt {fine:g} s"
    )
