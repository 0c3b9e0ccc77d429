"""The outcome and the ledger of every evaluation episode, by entry of the matrix."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from integ_gym.evidence.store import EvidenceStore

from ...panel.answer import finding_of
from ...panel.model.matrix import Entry
from ...panel.model.panel import Panel
from ...power import WITHOUT_VERDICT
from ...verdict import UNSOLVABLE
from ..data.forests import ordered_verdicts

Array = npt.NDArray[Any]

LEDGER: Final = ("motor", "numerics", "losses")
"""What adds up to the change of energy, losses taken away."""

_SQL: Final = """
SELECT policy_id, cell, episode_index, failure_label AS label, work_total AS motor,
  energy_residual_total AS numerics,
  dissipated_total + coalesce(contact_loss_total, 0) + clip_loss_total AS losses,
  coalesce(time_to_success, 'nan'::DOUBLE) AS "time", episode_index % trace_every = 0 AS traced
FROM records WHERE phase = 'evaluation'
"""


@dataclass(frozen=True)
class Outcomes:
    """What became of the episodes of one entry.

    Attributes:
        label: failure labels, shape (seeds, episodes).
        ledger: J, NaN where it is not known, shape (3, seeds, episodes), as :data:`LEDGER`.
        time: time to success, s, NaN where there is none, shape (seeds, episodes).
        traced: whether a trace was kept, shape (seeds, episodes).
    """

    label: Array
    ledger: Array
    time: Array
    traced: Array


def outcomes_of(panel: Panel, store: EvidenceStore) -> dict[tuple[str, str], Outcomes]:
    """Outcomes by row and cell, of the entries whose episodes are all on record."""
    table = store.query(_SQL)
    columns = {name: table.column(name).to_numpy(zero_copy_only=False) for name in
               table.column_names}  # fmt: skip
    order = np.lexsort((columns["episode_index"], columns["policy_id"], columns["cell"]))
    columns = {name: values[order] for name, values in columns.items()}
    groups = _groups(columns["policy_id"], columns["cell"])
    found = {}
    for entry in panel.matrix:
        own = _stacked(panel, entry, groups, columns)
        if own is not None:
            found[entry.row, entry.cell] = own
    return found


def _groups(policies: Array, cells: Array) -> dict[tuple[str, str], slice]:
    """Where the episodes of each policy and cell stand, neighbours as they are."""
    found: dict[tuple[str, str], slice] = {}
    start = 0
    for (policy, cell), own in itertools.groupby(zip(policies, cells, strict=True)):
        end = start + sum(1 for _ in own)
        found[str(policy), str(cell)] = slice(start, end)
        start = end
    return found


def _stacked(
    panel: Panel,
    entry: Entry,
    groups: Mapping[tuple[str, str], slice],
    columns: Mapping[str, Array],
) -> Outcomes | None:
    policies = panel.row(entry.row).policies
    slices = [groups.get((policy.id, entry.cell)) for policy in policies]
    sizes = {0 if found is None else found.stop - found.start for found in slices}
    if not policies or len(sizes) != 1 or sizes == {0}:
        return None

    def stacked(name: str) -> Array:
        return np.stack([columns[name][found] for found in slices])

    ledger = np.stack([stacked(name).astype(np.float64) for name in LEDGER])
    return Outcomes(
        stacked("label").astype(str), ledger, stacked("time").astype(float),
        stacked("traced").astype(bool),
    )  # fmt: skip


Kind: TypeAlias = Literal["held", "worst", "failure", "success"]
"""`held`: nothing is lost there, and this start shows it; the others as `chosen_words` says."""

MOST_TRACES: Final = 150
"""Traces that a page carries."""

_MOST_PAIRS: Final = 8


@dataclass(frozen=True)
class Lead:
    """An episode worth watching, and where else the same policy ran from the same start.

    Attributes:
        row, cell: names of its row and cell.
        seed: place of its policy in the row.
        episode: place among the policy's starts.
        kind: why it was chosen.
        cells: where it can be watched, its home first, its own cell second.
    """

    row: str
    cell: str
    seed: int
    episode: int
    kind: Kind
    cells: tuple[str, ...]


def chosen(panel: Panel, outcomes: Mapping[tuple[str, str], Outcomes]) -> list[Lead]:
    """Leads, that of the answer's first line before all others, then the most informative.

    They have at most :data:`MOST_TRACES` traces in all.
    """
    leads: list[Lead] = []
    traces: set[tuple[str, str, int, int]] = set()
    per_pair = [list(_leads(panel, pair, outcomes)) for pair in _pairs(panel, outcomes)]
    for depth in range(3):
        for found in per_pair:
            for lead in found[depth : depth + 1]:
                more = {(lead.row, cell, lead.seed, lead.episode) for cell in lead.cells}
                if len(traces | more) <= MOST_TRACES:
                    traces |= more
                    leads.append(lead)
    pairs = list(dict.fromkeys((lead.row, lead.cell) for lead in leads))
    return sorted(leads, key=lambda lead: pairs.index((lead.row, lead.cell)))


def chosen_words(panel: Panel) -> str:
    """What is chosen, in words."""
    cells = "of every cell of the declared family"
    if not panel.verdicts:
        cells = f"of the {_MOST_PAIRS} cells in which most success is lost"
    return (
        f"{cells}: the worst start of the seed that loses most, the median failure and the median "
        "success; each with the same policy and start at home, on the truth and on every "
        "integrator at its coarsest step"
    )


def _pairs(panel: Panel, outcomes: Mapping[tuple[str, str], Outcomes]) -> list[tuple[str, str]]:
    """What the first line of the answer speaks of, then the declared family.

    Of that what can be judged comes first; without any such, the largest losses do.
    """
    judged = ordered_verdicts(panel)
    informative = [one for one in judged if one.verdict not in WITHOUT_VERDICT]
    informative.sort(key=lambda one: -one.overfitting.estimate)
    pairs = [(one.row, one.cell) for one in (*informative, *judged)]
    if not informative:
        lost = [(entry.row, entry.cell) for entry in panel.exploratory]
        pairs = [*(lost or _largest_drops(panel)), *pairs]
    finding = finding_of(panel)
    if finding is not None and finding.cell is not None:
        pairs = [(finding.row, finding.cell), *pairs]
    return [pair for pair in dict.fromkeys(pairs) if pair in outcomes][:_MOST_PAIRS]


def _largest_drops(panel: Panel) -> list[tuple[str, str]]:
    columns = {cell.name for cell in panel.columns}

    def drop(entry: Entry) -> float:
        others = [
            other.success.estimate
            for cell in (_home(panel, entry.row), panel.truth and panel.truth.name)
            if cell and (other := panel.entry(entry.row, cell)) is not None
        ]
        return max(others, default=0.0) - entry.success.estimate

    entries = [
        entry
        for entry in panel.matrix
        if entry.cell in columns and not panel.row(entry.row).baseline
    ]
    entries.sort(key=lambda entry: (_unsolvable(panel, entry.cell), -drop(entry)))
    return [(entry.row, entry.cell) for entry in entries[:3]]


def _unsolvable(panel: Panel, cell: str) -> bool:
    """Whether nobody succeeds in a cell in time: then it judges the simulator."""
    return panel.cell(cell).achievability in UNSOLVABLE


def _leads(
    panel: Panel, pair: tuple[str, str], outcomes: Mapping[tuple[str, str], Outcomes]
) -> Iterator[Lead]:
    own, home = outcomes[pair], outcomes.get((pair[0], _home(panel, pair[0]) or ""))
    success = own.label == "none"
    at_home = np.ones_like(success) if home is None else home.label == "none"
    pump = _pump(own, home)
    seed = int(np.argmax(at_home.mean(axis=1) - success.mean(axis=1)))
    worst = _worst(~success[seed], at_home[seed], own.traced[seed], pump[seed])

    def lead(place: tuple[int, int], kind: Kind) -> Lead:
        return Lead(*pair, *place, kind, _cells(panel, pair, outcomes, place))

    taken = set()
    held = _median(success & at_home & own.traced, own.time) if _holds(panel, pair) else None
    if held is not None:
        taken.add(held)
        yield lead(held, "held")
    if worst is not None and (seed, worst) not in taken:
        taken.add((seed, worst))
        yield lead((seed, worst), "worst")
    kinds: tuple[tuple[Kind, Array, Array], ...] = (
        ("failure", ~success, pump),
        ("success", success, own.time),
    )
    for kind, wanted, by in kinds:
        place = _median(wanted & own.traced, by)
        if place is not None and place not in taken:
            yield lead(place, kind)


def _holds(panel: Panel, pair: tuple[str, str]) -> bool:
    """Whether the answer's first line says of a pair that nothing is lost."""
    finding = finding_of(panel)
    if finding is None or (finding.row, finding.cell) != pair:
        return False
    return finding.status in ("not_cause", "gained", "home_decides")


def _worst(failed: Array, at_home: Array, traced: Array, pump: Array) -> int | None:
    """A failure that succeeds at home, if there is one, in which the numerics differ by most."""
    wanted = failed & traced
    wanted = wanted & at_home if (wanted & at_home).any() else wanted
    return int(np.argmax(np.where(wanted, pump, -1.0))) if wanted.any() else None


def _pump(own: Outcomes, home: Outcomes | None) -> Array:
    """By how much the energy from the numerics differs from that at home, J."""
    at_home = 0.0 if home is None else home.ledger[1]
    difference: Array = np.nan_to_num(np.abs(own.ledger[1] - at_home))
    return difference


def _median(wanted: Array, by: Array) -> tuple[int, int] | None:
    places = np.argwhere(wanted)
    if not len(places):
        return None
    order = np.argsort(np.nan_to_num(by[wanted]), kind="stable")
    seed, episode = places[order[(len(order) - 1) // 2]]
    return int(seed), int(episode)


def _home(panel: Panel, row: str) -> str | None:
    """Name of a row's home, or of the first member of its mixture."""
    return panel.row(row).home or next(iter(panel.row(row).shares), None)


def _cells(
    panel: Panel,
    pair: tuple[str, str],
    outcomes: Mapping[tuple[str, str], Outcomes],
    place: tuple[int, int],
) -> tuple[str, ...]:
    """Home, the cell itself, the truth, and every integrator at its coarsest step.

    Behind the first two, what differs from both comes first: another ending than home's, and among
    those what the numerics gave or took most. Where nobody succeeds in time comes last.
    """
    row, cell = pair
    truth = panel.truth.name if panel.truth else None
    wanted = (_home(panel, row), cell, truth, *(group.cells[0].name for group in panel.groups))
    first, *others = dict.fromkeys(
        name for name in wanted if name and panel.entry(row, name) is not None
    )

    def telling(name: str) -> tuple[bool, bool, float]:
        own = outcomes.get((row, name))
        if own is None:
            return True, True, 0.0
        size = float(np.nan_to_num(abs(own.ledger[1][place])))
        return _unsolvable(panel, name), bool(own.label[place] == "none"), -size

    head = [name for name in others if name == cell]
    tail = sorted((name for name in others if name != cell), key=telling)
    return (first, *head, *tail)
