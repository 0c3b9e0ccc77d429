"""What `watch` shows: a policy from a file, or a record of a run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import TRUTH
from integ_gym.envs.settings import DISCRETIZATION, Discretization, unlike_names
from integ_gym.evidence.episodes import COMMANDED
from integ_gym.evidence.record import EvidenceRecord
from integ_gym.evidence.schema import parse_field
from integ_gym.evidence.store import EvidenceStore, open_run, sql_literal
from integ_gym.support.errors import InputError
from integ_gym.support.optional import require
from integ_gym.support.terminal import fixed
from integ_gym.train.policy import Policy
from integ_gym.train.policy_files.sidecar import read_trained, readable_file

from . import film
from .panel.cells import flatten, place_arguments
from .panel.policies import policy_of, read_existing
from .report.task import describe_motors


def side_by_side(
    policy: Policy | str | os.PathLike[str],
    discretizations: Sequence[film.Asked],
    seed: int,
    *,
    env_id: str | None = None,
    environment: Mapping[str, Any] | None = None,
    own_code: bool = False,
) -> film.Film:
    """One policy from one start in several discretizations, as a film.

    >>> film = side_by_side("runs/rk4", ["rk4", "explicit_euler", "truth"], 0)  # doctest: +SKIP
    >>> film.write("film.gif")  # doctest: +SKIP

    Args:
        policy: what acts; or the folder or file of a trained one, whose side-car says what it was
            trained on.
        discretizations: from left to right: ``"rk4"`` (with the rest as the policy was trained, or
            as in ``environment``), ``"rk4 dt=0.01"``, ``"mujoco RK4"``, ``"truth"``, a
            :class:`Discretization`, or a mapping of some of its parts; none: the policy's home and
            the truth.
        seed: of the start, the same as that of ``reset``.
        env_id: one of integ-gym's environments; needed where no side-car says it.
        environment: constructor arguments that differ from those of the training.
        own_code: whether classes that the side-car names as ``"module:Class"`` may be loaded.

    Returns:
        The film: frames of shape (height, width, 3), drawn when asked for, ``success`` by
        discretization, and ``write``.

    Raises:
        PolicyFileError, ValueError, TypeError: for a policy or a discretization that cannot be.
        ModuleNotFoundError: if an extra is missing, with the command that installs it.
    """
    require("render")
    given = dict(environment or {})
    if isinstance(policy, (str, os.PathLike)):
        path = readable_file(Path(policy)) if Path(policy).is_dir() else Path(policy)
        if env_id is None:
            _, card = read_trained(path)
            env_id = str(card["config"]["env_id"])
        film.check_filmed(env_id)
        existing = read_existing(path, env_id, given, None, own_code)
        acting: Policy = existing.policy
        arguments, seed_of = dict(existing.provenance.environment), existing.seed
        arguments["control_period"] = existing.provenance.control_period
        homes = tuple(existing.home.shares) if existing.home is not None else ()
    else:
        if own_code:
            raise InputError(
                "own_code is for the side-car of a policy's file, and this policy is none; omit it"
            )
        if env_id is None:
            raise InputError("a policy alone does not say what it acts in; give env_id as well")
        film.check_filmed(env_id)
        acting, arguments, homes, seed_of = policy, given, (), None
    like = homes[0] if homes else Discretization.of(environment_setup(env_id, arguments))
    cells = [
        film.parse_discretization(asked, like, env_id)
        for asked in discretizations or (*(homes or [like]), TRUTH)
    ]
    given_on = [place_arguments(cell, arguments) for cell in cells]
    for one in given_on:
        environment_setup(env_id, one)  # what cannot be is refused before any episode is played
    episodes = [film.play_episode(acting, env_id, one, seed) for one in given_on]
    return film.Film(
        episodes,
        homes,
        describe_episodes(acting.policy_id, homes, seed_of, episodes, f"start {seed}"),
    )


def describe_episodes(
    name: str,
    homes: Sequence[Discretization],
    seed: int | None,
    episodes: Sequence[film.Episode],
    start: str,
) -> str:
    """What all episodes of a film have in common, in one line.

    Args:
        name: of the policy.
        homes: what it was trained on.
        seed: of its training.
        episodes: all of them.
        start: where they start, in words.
    """
    names = (name.replace("_", " ").replace("=", " ") for name in unlike_names(homes))
    trained = " and ".join(names)
    by = [f"Trained on {trained} s" if homes else name]
    seeds = [f"seed {seed}"] if seed is not None else []
    motors = describe_motors(episodes[0].setup)
    periods = {episode.discretization.control_period for episode in episodes}
    decision = [f"a decision every {period:g} s" for period in periods if len(periods) == 1]
    return ", ".join([*by, *seeds, motors, *decision, start])


def watch(
    run: str | os.PathLike[str],
    record_id: str,
    on: Sequence[film.Asked] = (),
    *,
    own_code: bool = False,
    on_doubt: Callable[[str], None] = lambda doubt: None,
) -> film.Film:
    """A recorded episode as a film.

    Episodes that have traces are shown as they were recorded, others are played again.

    Args:
        run: directory of the run.
        record_id: id of the record, or how it begins.
        on: discretizations from left to right, see
            :func:`~integ_gym.eval.watch.side_by_side`; by default what the policy was
            trained on, the record's own, and the truth.
        own_code: whether classes that the record names as ``"module:Class"`` may be loaded.
        on_doubt: called where an episode, played again, ends otherwise than its record says, and
            where episodes are left out that cannot be played again.

    Raises:
        EvidenceError: for a run or a record that is not there.
        PolicyFileError, ValueError: if the policy is needed and not there any more.
        ModuleNotFoundError: if an extra is missing, with the command that installs it.
    """
    require("render", "evidence")
    store = open_run(Path(run))
    record = store.find(record_id)
    if (skeleton := film.skeleton_of(record)) is not None:
        return _watch_robot(record, skeleton, on, store)
    _check_code(record, own_code)
    film.check_filmed(record["env_id"])
    own = Discretization(**{name: record[name] for name in DISCRETIZATION})

    def parse(asked: Iterable[film.Asked]) -> list[Discretization]:
        cells = (film.parse_discretization(one, own, record["env_id"]) for one in asked)
        return list(dict.fromkeys(cells))

    trained = parse_field("training_discretization", record["training_discretization"]) or []
    homes = parse([trained] if isinstance(trained, dict) else trained)
    cells = parse(on or ((*homes, own, TRUTH) if record["policy_hash"] else (own,)))
    twins = _twins(record, own, store)
    policy = cache(partial(policy_of, record, store, own_code))
    traced = [cell for cell in cells if isinstance(twins.get(cell), EvidenceRecord)]
    if not on and traced and traced != cells:
        try:
            policy()
        except ValueError as error:
            on_doubt(f"{error}; shown is what has a trace")
            cells = traced
    for cell in cells:  # what cannot be is refused before any episode is played
        environment_setup(record["env_id"], place_arguments(cell, record.arguments()))
    episodes = [_episode(cell, record, twins.get(cell), policy, on_doubt) for cell in cells]
    changed = parse_field("perturbation", record["perturbation"]) or {}
    start = [f"start {record['episode_index']}", *(f"{k} {value}" for k, value in changed.items())]
    seed = record["training_seed"]
    note = describe_episodes(record["policy_id"], homes, seed, episodes, ", ".join(start))
    return film.Film(episodes, homes, note)


def _watch_robot(
    record: EvidenceRecord,
    skeleton: Mapping[str, Any],
    on: Sequence[film.Asked],
    store: EvidenceStore,
) -> film.Film:
    """Recorded episodes of a robot, of which no code is loaded: home, the record's, the finest."""
    own = Discretization(**{name: record[name] for name in DISCRETIZATION})
    twins = {
        cell: twin
        for cell, twin in _twins(record, own, store).items()
        if isinstance(twin, EvidenceRecord)
    }
    trained = parse_field("training_discretization", record["training_discretization"]) or []
    homes = [Discretization(**one) for one in ([trained] if isinstance(trained, dict) else trained)]
    if any(name in film.TRUE_NAMES for name in on):
        raise InputError("robots have no truth; leave it out")
    cells = [film.parse_discretization(asked, own, record["env_id"]) for asked in on]
    if not twins or not set(cells) <= set(twins):
        known = ", ".join(cell.name for cell in twins)
        raise InputError(
            "a film of a robot shows cells with a trace from this start; there is "
            f"{known or 'none'}"
        )
    finest = min(twins, key=lambda cell: cell.dt)
    shown = [cell for cell in dict.fromkeys(cells or (*homes, own, finest)) if cell in twins]
    episodes = [film.episode_of_robot(twins[cell], skeleton) for cell in shown]
    title = record["env_id"].rpartition(":")[2]
    command = [
        f"{name.removeprefix(COMMANDED).replace('_', ' ')} {fixed(values[0], 2)}"
        for name, values in record.trace.items()
        if name.startswith(COMMANDED)
    ]
    changed = parse_field("perturbation", record["perturbation"]) or {}
    words = [f"start {record['episode_index']}", *(f"{k} {value}" for k, value in flatten(changed))]
    return film.Film(episodes, homes, ", ".join([title, *words, *command]))


_CANDIDATES = """
SELECT record_id, cell, failure_label, count(*) OVER (PARTITION BY cell, failure_label) AS alike
FROM records
WHERE phase = 'evaluation' AND NOT success AND perturbation IS NULL AND policy_hash IS NOT NULL
QUALIFY row_number() OVER (
  PARTITION BY cell, failure_label ORDER BY energy IS NULL, episode_index, policy_id) = 1
ORDER BY failure_label != 'discretization_error', alike DESC, cell
LIMIT 10
"""


def candidates(run: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """Ten failed episodes at most that are worth a film, those that succeed at home first.

    Of each cell and failure label one, with a trace where there is one.

    Args:
        run: directory of the run.

    Returns:
        For each `record_id`, `cell`, `failure_label`, and `alike`: how many episodes of that cell
        have that label.

    Raises:
        EvidenceError: for a run that is not there.
    """
    return list(open_run(Path(run)).query(_CANDIDATES).to_pylist())


_SAME = ("phase", "env_id", "policy_id", "policy_hash", "episode_index", "seed", "perturbation")
"""Fields that records of one policy from one start have in common."""


def _check_code(record: EvidenceRecord, own_code: bool) -> None:
    """Refuse a record made with code of the user's own, unless it may be run."""
    values = (record["env_id"], *record.arguments().values())
    classes = [value for value in values if isinstance(value, str) and ":" in value]
    if classes and not own_code:
        raise InputError(
            f"the record names {classes[0]!r}, whose code would be run; if it is yours, pass "
            "--own-code"
        )


def _twins(
    record: EvidenceRecord, own: Discretization, store: EvidenceStore
) -> dict[Discretization, EvidenceRecord | bool]:
    """Discretization to the same policy's record from the same start; its success if untraced."""
    if not record["policy_hash"]:
        return {own: record if record.trace else bool(record["success"])}
    same = " AND ".join(
        f"{name} IS NOT DISTINCT FROM {sql_literal(record[name])}" for name in _SAME
    )
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


def _episode(
    cell: Discretization,
    record: EvidenceRecord,
    twin: EvidenceRecord | bool | None,
    policy: Callable[[], Policy],
    on_doubt: Callable[[str], None],
) -> film.Episode:
    if isinstance(twin, EvidenceRecord):
        return film.episode_of_record(twin)
    arguments = place_arguments(cell, record.arguments())
    start = record["initial_state"]
    episode = film.play_episode(policy(), record["env_id"], arguments, record["seed"], start)
    if twin is not None and twin != episode.success:
        recorded, again = (
            "succeeds" if success else "fails" for success in (twin, episode.success)
        )
        on_doubt(
            f"on {cell.name} the episode {recorded} in its record and {again} when it is played "
            "again: it depends on the last bits of the policy's actions"
        )
    return episode
