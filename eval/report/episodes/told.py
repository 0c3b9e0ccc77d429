"""What a page tells of single episodes: which are shown, their traces, and what can be played."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from integ_gym.evidence.store import EvidenceStore

from ...panel.model.panel import Panel
from .choice import Lead, Outcomes, chosen, outcomes_of
from .live import Live, live_of
from .traces import Trace, traces_of


@dataclass(frozen=True)
class Told:
    """Single episodes.

    Attributes:
        outcomes: of every episode, by row and cell.
        leads: what is worth watching, the most informative first.
        traces: of the leads.
        live: what can be simulated anew; None where nothing can.
    """

    outcomes: Mapping[tuple[str, str], Outcomes]
    leads: tuple[Lead, ...]
    traces: tuple[Trace, ...]
    live: Live | None = None


def told_by(panel: Panel, directory: str | PathLike[str]) -> Told | None:
    """What the evidence in a panel's directory tells; None where none is beside the panel.

    Raises:
        EvidenceError: for evidence that cannot be read.
    """
    store = EvidenceStore(Path(directory) / "evidence")
    if not store.files():
        return None
    outcomes = outcomes_of(panel, store)
    leads = chosen(panel, outcomes)
    traces = traces_of(panel, store, leads)
    there = {trace.key for trace in traces}
    shown = [lead for lead in leads if (lead.row, lead.cell, lead.seed, lead.episode) in there]
    live = live_of(panel, shown, Path(directory))
    return Told(outcomes, tuple(shown), tuple(traces), live)
