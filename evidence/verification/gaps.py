"""Episodes that a run does not have between those that it has."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from integ_gym.support import plural

from ..schema import Finding
from ..store import EvidenceStore

_COUNTED = """
SELECT phase, cell, policy_id, policy_hash, min(episode_index) AS first, max(episode_index) AS last,
       count(DISTINCT episode_index) AS present, count(*) AS records
FROM records GROUP BY ALL HAVING present < last - first + 1 OR records > present
ORDER BY phase, cell, policy_id, policy_hash
"""


def missing_episodes(store: EvidenceStore, part: bool = False) -> Iterator[Finding]:
    """Cells in which episodes between the first and the last are missing, or there twice.

    Args:
        store: of the records.
        part: whether they are a part of a run's, of which some may be missing.
    """
    for row in store.query(_COUNTED).to_pylist():
        missing = 0 if part else row["last"] - row["first"] + 1 - row["present"]
        twice = row["records"] - row["present"]
        episodes = f"of episodes {row['first']} to {row['last']}"
        counts = [f"{missing} missing {episodes}"] if missing else []
        counts += [f"{plural(twice, 'record')} too many {episodes}"] if twice else []
        if counts:
            yield Finding(_named(row), None, ", ".join(counts))


def _named(row: dict[str, Any]) -> str:
    return f"cell {row['cell']!r}, policy {row['policy_id']!r}"
