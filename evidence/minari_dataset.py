"""Records as a Minari data set: what an agent saw and did, and all the rest as ``infos``."""

from __future__ import annotations

import math
import re
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from integ_gym.envs.registries import ENVIRONMENTS, TRUTH
from integ_gym.envs.settings import NATIVE
from integ_gym.support.optional import load

from .record import EvidenceRecord
from .schema import EvidenceError, argument_values, parse_field
from .selection import NO_CHOICE, Columns, Selection, actions_of, column, columns_of, stack

_minari = partial(load, "minari", "exchange")

DATA_FORMAT = "arrow"


def write_minari(chosen: Selection, folder: Path) -> int:
    """Write a data set below a folder that then is `MINARI_DATASETS_PATH`; the number of episodes.

    Observations and rewards are those of the policy; actions the controls that its decisions asked
    for, after saturation. True state, controls, ledger and solver are `infos`, with NaN at the
    reset where they belong to a step. Each episode's metadata hold its record's fields.
    """
    minari, env_id = _minari(), chosen.env_id
    name = dataset_id(chosen)
    columns = columns_of(chosen.columns)
    data = (folder / name / "data").absolute()  # Minari adds a relative path to itself
    data.mkdir(parents=True)
    observations, actions, spec = _spaces(chosen, columns)
    storage = load("minari.dataset.minari_storage", "exchange").MinariStorage.new(
        data, observations, actions, spec, DATA_FORMAT
    )
    # Minari adds up all files of the data set after every episode.
    storage.get_size = lambda: 0.0
    for record in chosen.episodes():
        buffer = _episode(record, columns, observations, actions)
        if buffer is None:
            chosen.left_out[NO_CHOICE] += 1
            continue
        number = storage.total_episodes
        storage.update_episodes([buffer])
        storage.update_episode_metadata([{"integ_gym": record.summary()}], [number])
    del storage.get_size
    if not storage.total_episodes:
        raise EvidenceError(f"all records are episodes {NO_CHOICE}; export to another format")
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


def dataset_id(chosen: Selection) -> str:
    """``run/Environment-v0``."""
    run = re.sub(r"[^A-Za-z0-9_.-]+", "-", str(chosen.distinct("run_id")[0])).strip("-.") or "run"
    env = re.sub(r"[^A-Za-z0-9_.-]+", "-", re.sub(r"-v\d+$", "", chosen.env_id))
    return f"{run}/{env}-v0"


def _spaces(chosen: Selection, columns: Columns) -> tuple[Any, Any, Any]:
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


def _episode(record: EvidenceRecord, columns: Columns, seen: Any, acted: Any) -> Any:
    """A record as Minari's buffer; None where its actions are none of the space."""
    actions = actions_of(record, columns.controls)
    if actions is None:
        return None
    length = len(record.trace["reward"])
    last = np.arange(length) == length - 1
    fields = record.fields
    infos = {
        name: column(record, name, length + 1) for name in (*columns.states, *columns.instants)
    }
    for name in (*columns.controls, *columns.steps):
        infos[name] = np.concatenate(([np.nan], column(record, name, length)))
    return load("minari.data_collector", "exchange").EpisodeBuffer(
        seed=fields["seed"] if record.first_of_seed else None,
        observations=_values(seen, stack(record, columns.sensed, length + 1)),
        actions=_values(acted, actions),
        rewards=record.trace["reward"].tolist(),
        terminations=(last & fields["terminated"]).tolist(),
        truncations=(last & fields["truncated"]).tolist(),
        infos={name: values.tolist() for name, values in infos.items()},
    )


def _values(space: Any, numbers: Any) -> Any:
    """Values of a space, one below the other."""
    return numbers.reshape(len(numbers), *space.shape).astype(space.dtype)
