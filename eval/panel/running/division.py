"""Which policies are trained together: divided once, and noted, so that all runs of a panel agree.

What a policy is trained beside shows in the last bits of its weights. So what goes on after a kill,
with another number of processes or on another engine, keeps to the division that was begun with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from integ_gym.support.files.reading import read_object
from integ_gym.support.files.writing import write_json
from integ_gym.train.fleet.worker import GIB_PER_WORKER, Workers

from ..specification.growth import stages
from ..specification.panel_spec import PanelSpec
from .run_directory import RunDirectory
from .staging import DIVISION, WORK
from .units import Unit, is_there, trained_units, training_config

_CHUNKS = "together"


class Division(NamedTuple):
    """Who is trained together.

    Attributes:
        waiting: what is not finished, each with all that it is trained together with.
        noted: all that is to be noted, as plain data; None if nothing is new.
    """

    waiting: list[tuple[Unit, ...]]
    noted: dict[str, Any] | None


def waiting_chunks(
    spec: PanelSpec, directory: RunDirectory, workers: Workers, memory_gib: float | None = None
) -> list[tuple[Unit, ...]]:
    """The training runs that are not finished, divided and noted; see :func:`divide`."""
    division = divide(spec, directory, workers, memory_gib)
    note_division(directory, division.noted)
    return division.waiting


def divide(
    spec: PanelSpec, directory: RunDirectory, workers: Workers, memory_gib: float | None = None
) -> Division:
    """The training runs that are not finished, each with all that it is trained together with.

    Args:
        spec: the panel, or a stage of it.
        directory: held by the caller.
        workers: that the work is divided for, if it was not before.
        memory_gib: that they may take together.
    """
    units = {unit.policy: unit for unit in trained_units(spec)}
    waiting = {unit.policy for unit in units.values() if not is_there(spec, directory, unit)}
    held = (noted_division(directory) or {_CHUNKS: []})[_CHUNKS]
    chunks = [tuple(map(str, chunk)) for chunk in held if set(chunk) <= set(units)]
    known = {policy for chunk in chunks for policy in chunk}
    for stage in stages(spec):
        new = [u for u in trained_units(stage) if u.policy in waiting and u.policy not in known]
        chunks += _divided(spec, new, workers, memory_gib)
        known.update(unit.policy for unit in new)
    return Division(
        [tuple(units[p] for p in chunk) for chunk in chunks if waiting.intersection(chunk)],
        {_CHUNKS: chunks} if len(chunks) > len(held) else None,
    )


def note_division(directory: RunDirectory, noted: Mapping[str, Any] | None) -> None:
    """Note who is trained together, if that is new."""
    if noted is not None:
        write_json(directory.path / WORK / DIVISION, noted)


def noted_division(directory: RunDirectory) -> dict[str, Any] | None:
    """Who is trained together, as it was noted."""
    path = directory.path / WORK / DIVISION
    return read_object(path, {_CHUNKS: list}, "remove it") if path.exists() else None


def memory_of(spec: PanelSpec, workers: Workers) -> float:
    """What workers that may be on other machines may take together, GiB."""
    return spec.memory_gib or GIB_PER_WORKER[workers.device] * workers.count


def _divided(
    spec: PanelSpec, units: Sequence[Unit], workers: Workers, memory_gib: float | None
) -> list[tuple[str, ...]]:
    if not units:
        return []
    if not spec.fleet:
        return [(unit.policy,) for unit in units]
    from integ_gym.train.fleet.planning import plan

    configs = [training_config(spec, unit) for unit in units]
    chunks = plan(configs, workers, memory_gib)  # type: ignore[arg-type]
    return [tuple(units[place].policy for place in chunk.places) for chunk in chunks]
