"""A film of a recorded episode, beside the same policy's from the same start elsewhere."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

from integ_gym.envs.registries import TRUTH
from integ_gym.envs.settings import DISCRETIZATION, Discretization
from integ_gym.evidence.record import EvidenceRecord, told_perturbation, told_training
from integ_gym.evidence.store import EvidenceStore, open_run
from integ_gym.support.optional import require
from integ_gym.train.policy import Policy

from ..panel.existing.run_policies import policy_of
from .choosing import Asked, arguments_on, check_filmed, check_possible, chosen
from .episode import Episode, played, recorded
from .film import Film
from .of_policy import told


def watch(
    run: str | os.PathLike[str],
    record_id: str,
    on: Sequence[Asked] = (),
    *,
    own_code: bool = False,
    on_doubt: Callable[[str], None] = lambda doubt: None,
) -> Film:
    """A recorded episode as a film.

    Episodes that have traces are shown as they were recorded, others are played again.

    Args:
        run: directory of the run.
        record_id: id of the record, or how it begins.
        on: discretizations from left to right, see
            :func:`~integ_gym.eval.film.of_policy.side_by_side`; by default what the policy was
            trained on, the record's own, and the truth.
        own_code: whether classes that the record names as ``"module:Class"`` may be loaded.
        on_doubt: told where an episode, played again, ends otherwise than its record says, and why
            episodes are left out that cannot be played again.

    Raises:
        EvidenceError: for a run or a record that is not there.
        PolicyFileError, ValueError: if the policy is needed and not there any more.
        ModuleNotFoundError: if an extra is missing, with the command that installs it.
    """
    require("render", "evidence")
    store = open_run(Path(run))
    record = store.find(record_id)
    _check_code(record, own_code)
    check_filmed(record["env_id"])
    own = Discretization(**{name: record[name] for name in DISCRETIZATION})
    homes = tuple(dict.fromkeys(chosen(home, own, record["env_id"]) for home in _homes(record)))
    asked = on or ((*homes, own, TRUTH) if record["policy_hash"] else (own,))
    cells = list(dict.fromkeys(chosen(one, own, record["env_id"]) for one in asked))
    twins = _twins(record, own, store)
    policy = cache(partial(policy_of, record, store, own_code))
    if not on:
        cells = _possible(cells, twins, policy, on_doubt)
    check_possible(cells, record["env_id"], record.arguments())
    episodes = [_episode(cell, record, twins.get(cell), policy, on_doubt) for cell in cells]
    return Film(episodes, homes, _note(record, homes, episodes))


_CANDIDATES = """
SELECT record_id, cell, failure_label, count(*) OVER (PARTITION BY cell, failure_label) AS alike
FROM records
WHERE phase = 'evaluation' AND NOT success AND perturbation IS NULL AND policy_hash IS NOT NULL
QUALIFY row_number() OVER (
  PARTITION BY cell, failure_label ORDER BY energy IS NULL, episode_index, policy_id) = 1
ORDER BY failure_label != 'discretization_error', alike DESC, cell
LIMIT {limit}
"""


def candidates(run: str | os.PathLike[str], limit: int = 10) -> list[dict[str, Any]]:
    """Failed episodes that are worth a film, those that succeed at home first.

    Of each cell and failure label one, with a trace where there is one.

    Args:
        run: directory of the run.
        limit: how many at most.

    Returns:
        For each `record_id`, `cell`, `failure_label`, and `alike`: how many episodes of that cell
        have that label.

    Raises:
        EvidenceError: for a run that is not there.
    """
    found = open_run(Path(run)).query(_CANDIDATES.format(limit=limit))
    return list(found.to_pylist())


def _possible(
    cells: list[Discretization],
    twins: Mapping[Discretization, EvidenceRecord | bool],
    policy: Callable[[], Policy],
    on_doubt: Callable[[str], None],
) -> list[Discretization]:
    """All of them; where there is no policy any more, those whose episodes have traces."""
    traced = [cell for cell in cells if isinstance(twins.get(cell), EvidenceRecord)]
    if traced and traced != cells:
        try:
            policy()
        except ValueError as error:
            on_doubt(f"{error}; shown is what has a trace")
            return traced
    return cells


_SAME = ("phase", "env_id", "policy_id", "policy_hash", "episode_index", "seed", "perturbation")
"""Fields that records of one policy from one start have in common."""


def _check_code(record: EvidenceRecord, own_code: bool) -> None:
    """Refuse a record made with code of somebody's own, unless it may be run."""
    told = (record["env_id"], *record.arguments().values())
    named = [x for x in told if isinstance(x, str) and ":" in x]
    if named and not own_code:
        raise ValueError(
            f"the record names {named[0]!r}, whose code would be run; if it is yours, pass "
            "--own-code"
        )


def _homes(record: EvidenceRecord) -> list[dict[str, Any]]:
    stated = told_training(record.fields) or []
    return [stated] if isinstance(stated, dict) else stated


def _twins(
    record: EvidenceRecord, own: Discretization, store: EvidenceStore
) -> dict[Discretization, EvidenceRecord | bool]:
    """Discretization to the same policy's record from the same start; its success if untraced."""
    if not record["policy_hash"]:
        return {own: record if record.trace else bool(record["success"])}
    same = " AND ".join(f"{name} IS NOT DISTINCT FROM {_literal(record[name])}" for name in _SAME)
    found = store.query(
        f"SELECT record_id, success, energy IS NOT NULL AS traced, {', '.join(DISCRETIZATION)} "
        f"FROM records WHERE {same}"
    ).to_pylist()
    return {
        Discretization(**{name: row[name] for name in DISCRETIZATION}): (
            store.find(row["record_id"]) if row["traced"] else row["success"]
        )
        for row in found
    }


def _literal(value: Any) -> str:
    if value is None:
        return "NULL"
    return str(value) if isinstance(value, int) else "'" + str(value).replace("'", "''") + "'"


def _episode(
    cell: Discretization,
    record: EvidenceRecord,
    twin: EvidenceRecord | bool | None,
    policy: Callable[[], Policy],
    on_doubt: Callable[[str], None],
) -> Episode:
    if isinstance(twin, EvidenceRecord):
        return recorded(twin)
    arguments = arguments_on(cell, record.arguments())
    start = record["initial_state"]
    episode = played(policy(), record["env_id"], arguments, record["seed"], start)
    if twin is not None and twin != episode.success:
        on_doubt(
            f"on {cell.name} the episode {_ends(twin)} in its record and {_ends(episode.success)} "
            "when it is played again: it hangs on the last bits of the policy's actions"
        )
    return episode


def _ends(success: bool) -> str:
    return "succeeds" if success else "fails"


def _note(
    record: EvidenceRecord, homes: Sequence[Discretization], episodes: Sequence[Episode]
) -> str:
    changed = told_perturbation(record.fields) or {}
    start = ", ".join(
        [
            f"start {record['episode_index']}",
            *(f"{name} {value}" for name, value in changed.items()),
        ]
    )
    return told(record["policy_id"], homes, record["training_seed"], episodes, start)
