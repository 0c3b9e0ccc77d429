"""What can be done in a cell at all, tried before any policy is judged in it.

A hand-made controller acts from the starts of the first training seeds; where it fails, a search
over controls tells whether the goal's energy can be reached. Each cell is a unit of work, with the
starts that came at a time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import msgspec
import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.engines.stepping import engine_versions
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.processes import report_work

from ..verdict import ACHIEVED, Achieved, Attempt, Search, achieved
from .cells import Cell, environments_of, file_name
from .costs import trying_seconds
from .episodes import attempts
from .plan import inputs
from .run_directory import RunDirectory, first_of, key_of, name_start
from .spec import PanelSpec
from .units import HANDMADE, Work, baseline_of, has_controller

PREFIX = "achieve-"


class Tried(msgspec.Struct, frozen=True):
    """What was tried in a cell.

    Attributes:
        success: whether the hand-made controller succeeds within the horizon, start by start;
            empty without one.
        recovered: the same within one horizon or two.
        search: what a search over controls reaches; None where none was made.
    """

    success: tuple[float, ...] = ()
    recovered: tuple[float, ...] = ()
    search: Search | None = None

    @property
    def solved(self) -> bool:
        """Whether the hand-made controller shows that the goal can be reached."""
        return bool(self.recovered) and float(np.mean(self.recovered)) >= ACHIEVED

    def achieved(self, *others: Attempt) -> Achieved:
        """Whether the cell can be solved.

        Args:
            others: attempts beside the hand-made controller's.
        """
        own = []
        if self.success:
            rates = float(np.mean(self.success)), float(np.mean(self.recovered))
            own = [Attempt(None, *rates)]
        return achieved([*others, *own], self.search)


def try_cells(spec: PanelSpec, directory: RunDirectory, work: Work) -> None:
    """Try every cell of the matrix that has not been tried, each a unit that reports its time."""
    waiting = {unit_of_cell(*one): one for one in not_tried(spec, directory)}
    work.commit("trying to solve cells", try_and_note, waiting)


def not_tried(spec: PanelSpec, directory: RunDirectory) -> list[tuple[PanelSpec, Cell]]:
    """Cells of the matrix that have not been tried, each with the part of the panel that it is of.

    Raises:
        RunDirectoryError: if one was tried under another specification or version.
    """
    return [
        (part, cell)
        for part in spec.parts()
        for cell in part.columns()
        if directory.finished(unit_of_cell(part, cell), _key(part, cell)) is None
    ]


def tried(directory: RunDirectory, episodes: float = math.inf) -> dict[str, Tried]:
    """What was tried, by cell.

    Args:
        directory: of the run.
        episodes: how many starts of a seed are looked at.
    """
    markers = sorted(directory.markers(PREFIX).values(), key=first_of)
    found: dict[str, list[Tried]] = {}
    for marker in markers:
        if first_of(marker) < episodes:
            found.setdefault(marker["cell"], []).append(read_tried(marker))
    return {cell: _together(parts) for cell, parts in found.items()}


def try_cell(spec: PanelSpec, cell: Cell, store: EvidenceStore) -> tuple[Tried, list[Any]]:
    """What can be done in a cell, from the starts that came last, and the records of that."""
    success: tuple[float, ...] = ()
    recovered, tables = success, list[Any]()
    if has_controller(spec):
        found, later, tables = attempts(spec, cell, baseline_of(spec, HANDMADE), store)
        success, recovered = (tuple(x.ravel().astype(float).tolist()) for x in (found, later))
    own = Tried(success, recovered)
    search = None if own.solved else search_of(spec, cell)
    return msgspec.structs.replace(own, search=search), tables


def search_of(spec: PanelSpec, cell: Cell) -> Search | None:
    """What a search over controls reaches from the first starts; None where there is none."""
    if spec.testbed.horizon is None:
        return None
    environments = environments_of(spec.testbed, cell, len(spec.latest))
    seeds = [spec.start_seed(spec.start_sets[0], episode) for episode in spec.latest]
    environments.reset(seed=seeds)  # type: ignore[arg-type]
    starts = np.stack(environments.state_components, axis=-1)
    setup = environments.setups[0]
    environments.close()
    required = numerics.goal_energy(setup)
    if required is None or not setup.engine.batched:
        return None
    horizon = 2.0 * spec.nominal.settings.duration
    highest = numerics.reach(setup, starts, horizon, required).energy
    return Search(horizon, required, tuple(highest.tolist()), numerics.METHOD)


def try_and_note(spec: PanelSpec, directory: RunDirectory, cell: Cell) -> None:
    """Try a cell, and mark that as finished."""
    start = time.time()
    store, unit = EvidenceStore(directory.evidence), unit_of_cell(spec, cell)
    found, tables = try_cell(spec, cell, store)
    directory.discard_remains(unit)
    if tables:
        store.commit_all(unit, tables)
    directory.finish(
        unit, _key(spec, cell), start, first=spec.latest.start,
        cell=cell.name, **msgspec.to_builtins(found),
    )  # fmt: skip
    report_work(trying_seconds(spec, cell))


def read_tried(marker: Mapping[str, Any]) -> Tried:
    """What a unit's marker says was tried."""
    return msgspec.convert({name: marker[name] for name in Tried.__struct_fields__}, Tried)


def _together(parts: Sequence[Tried]) -> Tried:
    """What was tried from all starts; a search rules the goal out where it was made from all."""
    searches = [own.search for own in parts if own.search is not None]
    search = None
    if len(searches) == len(parts):
        highest = tuple(chain.from_iterable(own.highest for own in searches))
        search = msgspec.structs.replace(searches[0], highest=highest)
    return Tried(
        tuple(chain.from_iterable(own.success for own in parts)),
        tuple(chain.from_iterable(own.recovered for own in parts)),
        search,
    )


def unit_of_cell(spec: PanelSpec, cell: Cell) -> str:
    """Name of the unit that tries a cell from the starts that came last."""
    return f"{PREFIX}{file_name(cell.name)}{name_start(spec.latest.start)}"


def _key(spec: PanelSpec, cell: Cell) -> str:
    engine = engine_versions({cell.discretization.engine})
    return key_of(engine, spec=inputs(spec, [cell]), cell=cell.name)
