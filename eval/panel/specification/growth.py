"""Panels that grow: more seeds, and the parts of a panel that are shown before it is finished."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Final

from .cells.cell import Cell, changes_of
from .panel_spec import PanelSpec
from .values import SpecError

STAGES: Final = (4, 12)
"""Training seeds after which a page is written, while more are to come."""

FREE: Final = (
    *("question", "seeds", "exploratory_seeds", "train", "grid", "perturbations", "sweeps"),
    *("baselines", "family", "compare", "looks", "ladder", "sources"),
)
"""Parts of a specification that no record of a policy in a cell depends on."""

MOST_SEEDS: Final = 10_000
"""Seeds that a panel may have."""


def grown(spec: PanelSpec, seeds: int) -> PanelSpec:
    """The same panel with so many training seeds: its first, or all and new ones after the last.

    Raises:
        SpecError: for less than one, more than 10 000, or a panel without training.
    """
    if not spec.seeds:
        raise SpecError(f"panel {spec.name!r} trains nothing, so it has no seeds to add to")
    if not 1 <= seeds <= MOST_SEEDS:
        raise SpecError(f"a panel takes 1 to {MOST_SEEDS} seeds, got {seeds}")
    last = max(spec.seeds)
    new = range(last + 1, last + 1 + max(0, seeds - len(spec.seeds)))
    return replace(spec, seeds=(*spec.seeds[:seeds], *new))


def stages(spec: PanelSpec) -> tuple[PanelSpec, ...]:
    """The panel with its first seeds alone, with more, and whole.

    A stage that is more than half of what follows is left out: it would come no sooner.
    """
    counts = [count for count in STAGES if 2 * count < len(spec.seeds)]
    return (*(replace(spec, seeds=spec.seeds[:count]) for count in counts), spec)


def inputs(spec: PanelSpec, cells: Iterable[Cell]) -> dict[str, Any]:
    """What records in some cells depend on, beside the policies: nothing that may be added.

    Args:
        spec: the panel.
        cells: of the records.
    """
    told = spec.to_json()
    places = [
        (cell.name, cell.discretization.arguments(), dict(changes_of(cell))) for cell in cells
    ]
    sources = {
        name: source
        for name, source in told["sources"].items()
        if any(place["integrator"] == name for _, place, _ in places)
    }
    shared = {name: value for name, value in told.items() if name not in FREE}
    starts = {"start_sets": list(spec.start_sets)}
    return {**shared, **starts, "sources": sources, "cells": sorted(places)}
