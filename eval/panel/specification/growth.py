"""Panels that grow: more seeds, and the parts of a panel that are shown before it is finished."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from .panel_spec import PanelSpec
from .values import SpecError

STAGES: Final = (4, 12)
"""Training seeds after which a page is written, while more are to come."""

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


def inputs(spec: PanelSpec) -> dict[str, Any]:
    """What the records of one policy depend on: all of a panel but how many seeds it has."""
    told = spec.to_json()
    del told["seeds"], told["exploratory_seeds"]
    return {**told, "start_sets": list(spec.start_sets)}
