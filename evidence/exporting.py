"""Export of records in the formats of other tools: a store, MCAP files, a Minari data set."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import gymnasium as gym
import numpy as np

from integ_gym.envs.registries import ENVIRONMENTS, TRUTH
from integ_gym.envs.settings import NATIVE
from integ_gym.support.errors import InputError
from integ_gym.support.files import Kinds, cannot_write, file_hash, new_path, write_json
from integ_gym.support.optional import load
from integ_gym.support.terminal import WorkBar

from . import selection
from .record import EvidenceRecord
from .schema import EvidenceError, Finding, argument_values, parse_field
from .sealing import read_stated
from .store import EvidenceStore

EXPORT_FILE = "export.json"
FORMAT = "integ-gym export 1"

_KINDS: Kinds = {"format": str, "where": str, "records": int, "of": int, "files": dict}


def write_parquet(chosen: selection.Selection, folder: Path) -> int:
    """Write one file of records for each environment; the number of records.

    Rows are copied bit by bit, with their hashes, so that every `integ-gym evidence` command reads
    the folder as a run.
    """
    store = EvidenceStore(folder / "evidence")
    for env_id in chosen.env_ids:
        name = re.sub(r"[^A-Za-z0-9._-]+", "-", env_id).strip("._-") or "environment"
        store.commit_all(name, chosen.tables(env_id))
    content = {
        "format": FORMAT,
        "where": chosen.where,
        "records": store.count(),
        "of": chosen.store.count(),
        "files": {file.name: file_hash(file) for file in store.files()},
    }
    write_json(folder / EXPORT_FILE, content)
    return store.count()


def read_export(folder: Path) -> dict[str, Any] | None:
    """What an exported folder says of itself: `records` that are in it `of` so many; else None.

    Raises:
        EvidenceError: if that is damaged.
    """
    return read_stated(folder / EXPORT_FILE, _KINDS, FORMAT, "export the records again")


def find_changes_since_export(store: EvidenceStore, held: Mapping[str, Any]) -> Iterator[Finding]:
    """Files of an exported folder that were changed, added or removed since.

    Args:
        store: of the folder.
        held: what :func:`read_export` read.
    """
    now = {file.name: file_hash(file) for file in store.files()}
    for name in sorted({*held["files"], *now}):
        if held["files"].get(name) != now.get(name):
            yield Finding(name, None, f"is not what was exported, as {EXPORT_FILE} says")


# MCAP: files of ROS 2 messages, one for each episode

PREFIX = "/evidence/"
"""Of the topics of single columns."""

JOINTS = "/joint_states"

_RATE = "_dot"
"""What the name of a coordinate's rate ends with."""

_FLOAT = "float64 data\n"

_JOINT_STATE = f"""\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{"=" * 80}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{"=" * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def write_mcap(chosen: selection.Selection, folder: Path) -> int:
    """Write a file for each record; how many.

    The state is a `sensor_msgs/msg/JointState` at every control instant, every column of the trace
    a `std_msgs/msg/Float64`, of control steps at the instant at which the step begins. Times are
    simulated, from 0. The record, units, frames and meanings are metadata of the file.
    """
    columns, count = selection.columns_of(chosen.columns), 0
    for record in chosen.episodes():
        with (folder / f"{record['record_id']}.mcap").open("wb") as file:
            _write(record, columns, chosen.columns, file)
        count += 1
    return count


def _write(
    record: EvidenceRecord, columns: selection.Columns, facts: dict[str, dict[str, str]], file: Any
) -> None:
    with load("mcap_ros2.writer", "exchange").Writer(file) as writer:
        real = writer.register_msgdef("std_msgs/msg/Float64", _FLOAT)
        joints = writer.register_msgdef("sensor_msgs/msg/JointState", _JOINT_STATE)
        rows = len(record.trace["reward"]) + 1
        seconds = record.trace.get("time")  # or else the numbers of the instants
        times = range(rows) if seconds is None else [round(1e9 * x) for x in seconds.tolist()]
        states = {name: selection.column(record, name, rows) for name in columns.states}
        names = [name for name in states if f"{name}{_RATE}" in states]
        values = {name: record.trace[name] for name in facts if name in record.trace}
        for place, time in enumerate(times):
            stamp = {"log_time": time, "sequence": place}
            if names:
                message = _joint_state(names, states, place, time)
                writer.write_message(JOINTS, joints, message, **stamp)
            for name, numbers in values.items():
                if place < len(numbers) and math.isfinite(numbers[place]):
                    message = {"data": float(numbers[place])}
                    writer.write_message(f"{PREFIX}{name}", real, message, **stamp)
        summary = record.summary().items()
        texts = {name: x if isinstance(x, str) else json.dumps(x) for name, x in summary}
        writer.add_metadata("integ_gym.record", texts)
        for about in ("unit", "frame", "meaning", "at"):
            said = {name: facts[name][about] for name in values}
            writer.add_metadata(f"integ_gym.{about}", said)


def _joint_state(names: list[str], states: dict[str, Any], place: int, time: int) -> dict[str, Any]:
    """A message of the state components whose rate is one too."""
    seconds, rest = divmod(time, 10**9)
    return {
        "header": {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": ""},
        "name": names,
        "position": [float(states[name][place]) for name in names],
        "velocity": [float(states[f"{name}{_RATE}"][place]) for name in names],
        "effort": [],
    }


# Minari: what an agent saw and did, and all the rest as ``infos``


def write_minari(chosen: selection.Selection, folder: Path) -> int:
    """Write a data set below a folder that then is `MINARI_DATASETS_PATH`; the number of episodes.

    Observations and rewards are those of the policy; actions the controls that its decisions asked
    for, after saturation. True state, controls, ledger and solver are `infos`, with NaN at the
    reset where they belong to a step. Each episode's metadata hold its record's fields.
    """
    minari, env_id = load("minari", "exchange"), chosen.env_id
    name = dataset_id(chosen)
    columns = selection.columns_of(chosen.columns)
    data = (folder / name / "data").absolute()  # Minari adds a relative path to itself
    data.mkdir(parents=True)
    observations, actions, spec = _spaces(chosen, columns)
    storage = load("minari.dataset.minari_storage", "exchange").MinariStorage.new(
        data, observations, actions, spec, "arrow"
    )
    # Minari adds up all files of the data set after every episode.
    storage.get_size = lambda: 0.0
    for record in chosen.episodes():
        buffer = _episode(record, columns, observations, actions)
        if buffer is None:
            chosen.left_out[selection.NO_CHOICE] += 1
            continue
        number = storage.total_episodes
        storage.update_episodes([buffer])
        storage.update_episode_metadata([{"integ_gym": record.summary()}], [number])
    del storage.get_size
    if not storage.total_episodes:
        raise EvidenceError(
            f"all records are episodes {selection.NO_CHOICE}; export to another format"
        )
    storage.update_metadata(
        {
            "dataset_id": name,
            "minari_version": minari.__version__,
            "dataset_size": float(storage.get_size()),
            "description": f"Evidence records of {env_id}. Actions are the controls that decisions "
            "asked for, after saturation and fallback. `integ_gym` has units, frames and meanings "
            "of all columns, and an episode's metadata its whole record.",
            "integ_gym": {"columns": chosen.columns, "discretizations": chosen.discretizations()},
        }
    )
    return int(storage.total_episodes)


def dataset_id(chosen: selection.Selection) -> str:
    """``run/Environment-v0``."""
    run = re.sub(r"[^A-Za-z0-9_.-]+", "-", str(chosen.distinct("run_id")[0])).strip("-.") or "run"
    env = re.sub(r"[^A-Za-z0-9_.-]+", "-", re.sub(r"-v\d+$", "", chosen.env_id))
    return f"{run}/{env}-v0"


def _spaces(chosen: selection.Selection, columns: selection.Columns) -> tuple[Any, Any, Any]:
    """Spaces that hold all episodes, and the environment if it is the same for all."""
    texts, of = chosen.distinct("arguments"), "engine_description"
    if chosen.env_id not in ENVIRONMENTS:
        descriptions = [parse_field(of, text) for text in chosen.distinct(of)]
        return (
            _space_from_records("observation", descriptions, columns.sensed, np.float32),
            _space_from_records("action", descriptions, columns.controls, np.float64),
            None,
        )
    solved = {"engine": NATIVE, "integrator": TRUTH}  # without code that a record names
    envs = [gym.make(chosen.env_id, **{**argument_values(text), **solved}) for text in texts]
    observations, actions = (
        _widest([getattr(env, f"{kind}_space") for env in envs])
        for kind in ("observation", "action")
    )
    if len(texts) > 1:
        return observations, actions, None
    spec: Any = deepcopy(envs[0].spec)
    spec.kwargs = {**spec.kwargs, **argument_values(texts[0])}
    return observations, actions, spec


def _space_from_records(
    of: str, descriptions: list[Any], names: tuple[str, ...], dtype: Any
) -> Any:
    """The space of an environment that is not ours, as its records say it, without bounds.

    Raises:
        EvidenceError: for a space of which a trace has numbers that are no value of it.
    """
    spaces = [one.get(f"{of}_space") for one in descriptions if one.get("known") is False]
    if not spaces:
        return gym.spaces.Box(-np.inf, np.inf, (len(names),), dtype)
    space = spaces[0]
    if space is None or any(other != space for other in spaces):
        raise EvidenceError(
            f"the records do not have one {of} space in common; export to csv, jsonl or parquet"
        )
    if space["kind"] == "Discrete":
        return gym.spaces.Discrete(space["n"], start=space["start"])
    if space["kind"] != "Box" or math.prod(space["shape"]) != len(names):
        raise EvidenceError(
            f"records do not hold {of}s as values of their {space['kind']} space; export to csv, "
            "jsonl or parquet"
        )
    kind = np.dtype(space["dtype"])
    low, high = -np.inf, np.inf
    if kind.kind != "f":
        low, high = np.iinfo(kind).min, np.iinfo(kind).max
    return gym.spaces.Box(low, high, tuple(space["shape"]), kind.type)


def _widest(spaces: list[Any]) -> Any:
    first = spaces[0]
    if not isinstance(first, gym.spaces.Box):
        return first
    low = np.min([space.low for space in spaces], axis=0)
    high = np.max([space.high for space in spaces], axis=0)
    dtype: Any = first.dtype
    return gym.spaces.Box(low, high, dtype=dtype)


def _episode(record: EvidenceRecord, columns: selection.Columns, seen: Any, acted: Any) -> Any:
    """A record as Minari's buffer; None where its actions are none of the space."""
    actions = selection.actions_of(record, columns.controls)
    if actions is None:
        return None
    length = len(record.trace["reward"])
    last = np.arange(length) == length - 1
    fields = record.fields
    infos = {
        name: selection.column(record, name, length + 1)
        for name in (*columns.states, *columns.instants)
    }
    for name in (*columns.controls, *columns.steps):
        infos[name] = np.concatenate(([np.nan], selection.column(record, name, length)))
    return load("minari.data_collector", "exchange").EpisodeBuffer(
        seed=fields["seed"] if record.first_of_seed else None,
        observations=_values(seen, selection.stack(record, columns.sensed, length + 1)),
        actions=_values(acted, actions),
        rewards=record.trace["reward"].tolist(),
        terminations=(last & fields["terminated"]).tolist(),
        truncations=(last & fields["truncated"]).tolist(),
        infos={name: values.tolist() for name, values in infos.items()},
    )


def _values(space: Any, numbers: Any) -> Any:
    """Values of a space, one below the other."""
    return numbers.reshape(len(numbers), *space.shape).astype(space.dtype)


# All formats

Episodes = Iterator[EvidenceRecord]

_TEXTS: dict[str, Callable[[Episodes, TextIO], int]] = {
    "csv": selection.write_csv,
    "jsonl": selection.write_jsonl,
}

_FOLDERS: dict[str, Callable[[selection.Selection, Path], int]] = {
    "parquet": write_parquet,
    "minari": write_minari,
    "mcap": write_mcap,
}

_OF_TRACES = ("minari", "mcap")
"""Formats of what happened step by step."""

TEXT_FORMATS = tuple(_TEXTS)
"""Formats that are one file of text; the others are a folder."""

EXPORT_FORMATS = (*_TEXTS, *_FOLDERS)


class Exported(NamedTuple):
    """What an export did.

    Attributes:
        records: that were written.
        left_out: why records were not, in words, to how many.
    """

    records: int
    left_out: dict[str, int]


def export(
    store: EvidenceStore,
    form: str,
    out: Path | TextIO,
    *,
    where: str = "TRUE",
    progress: bool = False,
) -> Exported:
    """Write records in another format; docs/reference/evidence.md has what each carries and loses.

    Args:
        store: of the run.
        form: one of `EXPORT_FORMATS`.
        out: where to, which must not be there yet: a file for `TEXT_FORMATS`, also one that is
            open and was opened with ``newline=""``; a folder for the others.
        where: condition in SQL on the columns of the records.
        progress: show a bar on standard error.

    Raises:
        EvidenceError: if there is such a path, for a condition that DuckDB refuses or that no
            record meets, and for records that the format cannot hold.
        ModuleNotFoundError: if an extra is missing, with the command that installs it.
        ValueError: for another format, or where nothing can be written.
    """
    if form not in EXPORT_FORMATS:
        raise InputError(f"the format must be one of {', '.join(EXPORT_FORMATS)}, got {form!r}")
    chosen = selection.select(store, where, traced=form in _OF_TRACES)
    if form in _TEXTS:
        episodes = chosen.episodes(trace=False)
        if not isinstance(out, Path):
            return Exported(_TEXTS[form](episodes, out), chosen.left_out)
        with _new(out) as part, part.open("w", encoding="utf-8", newline="") as file:
            return Exported(_TEXTS[form](episodes, file), chosen.left_out)
    assert isinstance(out, Path)
    with _new(out) as folder, WorkBar(f"export {form}", len(chosen.ids), progress) as bar:
        folder.mkdir()
        chosen.report = bar.update
        written = _FOLDERS[form](chosen, folder)
    return Exported(written, chosen.left_out)


@contextmanager
def _new(out: Path) -> Iterator[Path]:
    try:
        with new_path(out) as part:
            yield part
    except FileExistsError:
        raise EvidenceError(f"{out} exists, and is not replaced; give another --out") from None
    except OSError as error:
        raise cannot_write(out, error) from None
