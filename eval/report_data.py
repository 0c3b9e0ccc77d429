"""What the report and the figures both read out of ``panel.json``, schema version 1.

Nothing here draws, and nothing here computes a statistic: every number comes from the panel.
This module names the parts of a panel, groups the cells the way a reader meets them, and says
in plain words what the classes against the reference mean.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from typing import Any, Final, TypeAlias

Json: TypeAlias = Mapping[str, Any]
"""A JSON object as `json.load` gives it."""

SCHEMA_VERSION: Final = 1
"""Version of ``panel.json`` that is understood here."""

PASS: Final = 0.5
"""Success rate from which on a row passes, as in `integ_gym.eval.verdict.reference_class`."""

NONE: Final = "–"
"""Shown where the panel has no value."""

CLASS_WORDS: Final = {
    "true_pass": "true pass",
    "false_pass": "false pass",
    "false_fail": "false fail",
    "true_fail": "true fail",
}
"""The classes against the reference in words."""

VERDICT_ORDER: Final = ("fails", "transfers", "inconclusive", "not_learned")
"""Order in which verdicts are shown."""

_NAMED: Final = 5  # names in one sentence
_SUPERSCRIPT: Final = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


@dataclass(frozen=True)
class Estimate:
    """A number with its interval; the ends are None where the panel has none."""

    estimate: float
    low: float | None = None
    high: float | None = None
    level: float | None = None

    @property
    def bounded(self) -> bool:
        """Whether both ends are known."""
        return self.low is not None and self.high is not None

    @property
    def ends(self) -> tuple[float, float]:
        """Both ends; the estimate itself where an end is unknown."""
        return (
            self.estimate if self.low is None else self.low,
            self.estimate if self.high is None else self.high,
        )

    def __str__(self) -> str:
        if not self.bounded:
            return fixed(self.estimate)
        return f"{fixed(self.estimate)} ({fixed(self.low)} to {fixed(self.high)})"


def finite(value: Any) -> float | None:
    """The value as a float, or None if it is no finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def estimate(raw: Any) -> Estimate | None:
    """Read ``{"estimate", "low", "high", "level"}``; None without a finite estimate."""
    if not isinstance(raw, Mapping):
        return None
    middle = finite(raw.get("estimate"))
    if middle is None:
        return None
    low, high, level = (finite(raw.get(name)) for name in ("low", "high", "level"))
    return Estimate(middle, low, high, level)


def fixed(value: float | None, digits: int = 2, sign: bool = False) -> str:
    """A number with a fixed count of decimals and a true minus sign."""
    if value is None or not math.isfinite(value):
        return NONE
    plus = "+" if sign and round(value, digits) > 0.0 else ""
    return plus + f"{value:z.{digits}f}".replace("-", "−")


def compact(value: float | None, digits: int = 2, sign: bool = False) -> str:
    """A number with a few significant digits, in powers of ten where it is large or small."""
    if value is None or not math.isfinite(value):
        return NONE
    plus = "+" if sign and value > 0.0 else ""
    value = float(f"{value:.{digits - 1}e}")
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
        return plus + f"{value:z.{decimals}f}".replace("-", "−")
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    power = str(int(exponent)).translate(_SUPERSCRIPT)
    return f"{plus}{mantissa}·10{power}".replace("-", "−")


def seconds(value: Any) -> str:
    """A duration in the units a person would say it in."""
    number = finite(value)
    if number is None:
        return NONE
    if number < 60.0:
        return f"{number:.3g} s"
    minutes, rest = divmod(round(number), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def step(value: float | None) -> str:
    """A step size in seconds, without a unit."""
    return NONE if value is None else f"{value:.6g}"


def plural(count: int, noun: str, more: str | None = None) -> str:
    """``1 cell``, ``2 cells``."""
    return f"{count:,} {noun if count == 1 else more or noun + 's'}"


@dataclass(frozen=True)
class Row:
    """Policies of one training discretization (or baseline), one for each training seed."""

    index: int
    name: str
    kind: str
    homes: tuple[str, ...]
    integrator: str | None
    control_period: float | None
    seeds: int
    home_success: Estimate | None
    learned: bool | None
    training_steps: int | None
    policies: tuple[Json, ...]

    @property
    def baseline(self) -> bool:
        """Whether nobody trained it."""
        return self.kind == "baseline"

    @property
    def mixed(self) -> bool:
        """Whether it was trained on a mixture of discretizations."""
        return len(self.homes) > 1


@dataclass(frozen=True)
class Cell:
    """One discretization in which policies were evaluated."""

    index: int
    name: str
    engine: str
    integrator: str
    dt: float | None
    control_period: float | None
    kind: str
    perturbation: str | None
    role: str | None

    @property
    def reference(self) -> bool:
        """Whether this is the truth column."""
        return self.perturbation is None and "reference" in (self.kind, self.role)

    @property
    def scheme(self) -> str:
        """Integrator, and the engine where it is not ours."""
        return self.integrator if self.engine == "native" else f"{self.engine} {self.integrator}"

    @property
    def plain(self) -> bool:
        """Whether the plant and its delays are those of the spec."""
        return self.perturbation is None and self.kind != "perturbation"


@dataclass(frozen=True)
class Entry:
    """What one row did in one cell."""

    row: Row
    cell: Cell
    episodes: int | None
    success: Estimate | None
    success_by_seed: tuple[float, ...]
    returns: Estimate | None
    time_to_success: Estimate | None
    time_to_success_episodes: int | None
    energy_residual: Estimate | None
    energy_residual_abs: Estimate | None
    diverged: int
    not_converged: int
    home_drop: Estimate | None
    transfer_gap: Estimate | None
    reference_class: str | None
    labels: Mapping[str, int]
    files: tuple[str, ...]
    query: str | None

    @property
    def home(self) -> bool:
        """Whether the row was trained in this cell."""
        return self.cell.name in self.row.homes

    @property
    def anchor(self) -> str:
        """Name of the entry's place in the report."""
        return f"r{self.row.index}c{self.cell.index}"


@dataclass(frozen=True)
class Gap:
    """A loss of success with its interval, and where it comes from."""

    row: str
    cell: str
    quantity: str
    value: Estimate
    verdict: str | None = None
    anchor: str | None = None

    @property
    def declared(self) -> bool:
        """Whether it belongs to the declared family."""
        return self.verdict is not None


@dataclass(frozen=True)
class Group:
    """Neighbouring columns: one integrator from its coarsest step to its finest."""

    label: str
    cells: tuple[Cell, ...]
    reference: bool = False


@dataclass(frozen=True)
class Rung:
    """Success at one step of a refinement ladder."""

    dt: float
    entry: Entry


@dataclass(frozen=True)
class Ladder:
    """Success of one row under refinement.

    Attributes
    ----------
    fixed
        For every scheme, rungs from coarse to fine at the row's own control period.
    following
        The same where the control period is the step itself; empty where the panel has none.
    truth
        The row on the reference at its own control period, or None.
    """

    row: Row
    control_period: float | None
    fixed: Mapping[str, tuple[Rung, ...]]
    following: Mapping[str, tuple[Rung, ...]]
    truth: Entry | None


@dataclass(frozen=True)
class Check:
    """One row before and after a change of the plant or its delays."""

    before: Entry | None
    after: Entry


@dataclass(frozen=True)
class Trust:
    """How far one discretization agrees with the reference."""

    cell: Cell
    judged: tuple[Entry, ...]

    def of(self, kind: str) -> tuple[Entry, ...]:
        """Entries of one class against the reference."""
        return tuple(entry for entry in self.judged if entry.reference_class == kind)

    @property
    def agreeing(self) -> int:
        """Number of rows that the cell and the reference agree about."""
        return len(self.of("true_pass")) + len(self.of("true_fail"))


@dataclass(frozen=True)
class Finding:
    """One plain sentence about false passes or false fails.

    Attributes
    ----------
    kind
        `false_pass`, `false_fail`, `agreement` or `missing`.
    lead
        The sentence.
    close
        Whether seed noise alone could move a rate in it across the line.
    anchors
        Places of the cells it speaks of.
    """

    kind: str
    lead: str
    close: bool = False
    anchors: tuple[str, ...] = ()


@dataclass
class Panel:
    """A panel, parsed.

    Raises
    ------
    ValueError
        If the schema version is another one, a name occurs twice, or the matrix names a row or
        cell that the panel does not declare.
    """

    raw: Json
    rows: tuple[Row, ...] = field(init=False)
    cells: tuple[Cell, ...] = field(init=False)
    entries: Mapping[tuple[str, str], Entry] = field(init=False)

    def __post_init__(self) -> None:
        version = self.raw.get("schema_version")
        if version != SCHEMA_VERSION:
            raise ValueError(
                f"expected panel schema_version {SCHEMA_VERSION}, got {version!r}; "
                "use the integ-gym version that wrote the panel"
            )
        self.rows = tuple(_row(i, raw) for i, raw in enumerate(_list(self.raw, "rows")))
        self.cells = tuple(_cell(i, raw) for i, raw in enumerate(_list(self.raw, "cells")))
        self.entries = self._matrix()

    def _matrix(self) -> dict[tuple[str, str], Entry]:
        rows, cells = _by_name(self.rows, "row"), _by_name(self.cells, "cell")
        entries: dict[tuple[str, str], Entry] = {}
        for raw in _list(self.raw, "matrix"):
            key = (str(raw.get("row")), str(raw.get("cell")))
            if key[0] not in rows or key[1] not in cells:
                raise ValueError(f"the matrix has {key}, but rows and cells do not declare both")
            if key in entries:
                raise ValueError(f"the matrix has {key} more than once")
            entries[key] = _entry(rows[key[0]], cells[key[1]], raw)
        return entries

    def text(self, name: str, default: str = "") -> str:
        """A top-level text, or the default where it is missing or null."""
        value = self.raw.get(name)
        return default if value is None else str(value)

    def mapping(self, name: str) -> Json:
        """A top-level object, empty where it is missing or null."""
        value = self.raw.get(name)
        return value if isinstance(value, Mapping) else {}

    def items(self, name: str) -> list[Json]:
        """A top-level list of objects, empty where it is missing or null."""
        return _list(self.raw, name)

    def entry(self, row: Row | None, cell: Cell | None) -> Entry | None:
        """What a row did in a cell, or None where it was not evaluated."""
        if row is None or cell is None:
            return None
        return self.entries.get((row.name, cell.name))

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """Columns of the success matrix, the reference last."""
        by_scheme: dict[str, list[Cell]] = {}
        truth = [cell for cell in self.cells if cell.reference]
        for cell in self.cells:
            if cell.kind == "grid" and cell.plain and not cell.reference:
                by_scheme.setdefault(cell.scheme, []).append(cell)
        groups = [Group(name, _coarse_first(cells)) for name, cells in by_scheme.items()]
        if truth:
            groups.append(Group("reference", tuple(truth), reference=True))
        return tuple(groups)

    @cached_property
    def columns(self) -> tuple[Cell, ...]:
        """Cells of the success matrix, in column order."""
        return tuple(cell for group in self.groups for cell in group.cells)

    @cached_property
    def ordered_rows(self) -> tuple[Row, ...]:
        """Trained rows, then given policies, then baselines."""
        rank = {"trained": 0, "given": 1, "baseline": 2}
        return tuple(sorted(self.rows, key=lambda row: rank.get(row.kind, 1)))

    @cached_property
    def truth(self) -> Cell | None:
        """The reference cell, or None."""
        return next((cell for cell in self.cells if cell.reference), None)

    @cached_property
    def mixed_periods(self) -> bool:
        """Whether the matrix mixes control periods, so that columns must name theirs."""
        return len({cell.control_period for cell in self.columns}) > 1

    @cached_property
    def verdicts(self) -> tuple[tuple[Gap, Json], ...]:
        """Judgements of the declared family, the ones that matter most first."""
        judged = [(self._judged(raw), raw) for raw in self.items("verdicts")]

        def order(item: tuple[Gap, Json]) -> tuple[int, float]:
            verdict = item[0].verdict
            place = VERDICT_ORDER.index(verdict) if verdict in VERDICT_ORDER else 9
            return place, -item[0].value.estimate

        return tuple(sorted(judged, key=order))

    def _judged(self, raw: Json) -> Gap:
        row, cell = str(raw.get("row", NONE)), str(raw.get("cell", NONE))
        value = estimate(raw.get("gap")) or Estimate(math.nan)
        entry = self.entries.get((row, cell))
        return Gap(
            row,
            cell,
            str(raw.get("quantity") or "transfer_gap"),
            value,
            str(raw.get("verdict") or "inconclusive"),
            None if entry is None else entry.anchor,
        )

    @cached_property
    def declared_gaps(self) -> tuple[Gap, ...]:
        """Gaps of the declared family, largest first; a row that did not learn has none."""
        gaps = [
            gap
            for gap, _ in self.verdicts
            if gap.verdict != "not_learned" and not math.isnan(gap.value.estimate)
        ]
        return tuple(sorted(gaps, key=lambda gap: -gap.value.estimate))

    @cached_property
    def exploratory_gaps(self) -> tuple[Gap, ...]:
        """The matrix's other gaps, largest first; home drops where there is no transfer gap.

        Rows that did not learn and baselines have nothing to transfer and are left out.
        """
        declared = {(gap.row, gap.cell) for gap in self.declared_gaps}
        gaps = []
        for entry in self.entries.values():
            if entry.row.baseline or entry.row.learned is False or entry.home:
                continue
            if (entry.row.name, entry.cell.name) in declared or entry.cell not in self.columns:
                continue
            quantity = "home_drop" if entry.transfer_gap is None else "transfer_gap"
            value = entry.transfer_gap or entry.home_drop
            if value is not None:
                names = entry.row.name, entry.cell.name
                gaps.append(Gap(*names, quantity, value, anchor=entry.anchor))
        return tuple(sorted(gaps, key=lambda gap: -gap.value.estimate))

    @cached_property
    def ladders(self) -> tuple[Ladder, ...]:
        """Refinement ladders of the rows that have one.

        Rows that did not learn are left out if others did, and baselines if others are there.
        """
        ladders = [ladder for row in self.ordered_rows if (ladder := self._ladder(row))]
        others = [ladder for ladder in ladders if not ladder.row.baseline]
        learned = [ladder for ladder in others if ladder.row.learned is not False]
        return tuple(learned or others or ladders)

    def _ladder(self, row: Row) -> Ladder | None:
        period = row.control_period if row.control_period is not None else self._usual_period
        fixed_period: dict[str, list[Rung]] = {}
        following: dict[str, list[Rung]] = {}
        engines = {"native", *(cell.engine for cell in self.cells if cell.name in row.homes)}
        for cell in self.cells:
            entry = self.entry(row, cell) if cell.engine in engines else None
            if entry is None or entry.success is None or not cell.plain or cell.dt is None:
                continue
            if _close(cell.control_period, cell.dt):
                following.setdefault(cell.scheme, []).append(Rung(cell.dt, entry))
            if _close(cell.control_period, period) and not cell.reference:
                fixed_period.setdefault(cell.scheme, []).append(Rung(cell.dt, entry))
        at_fixed, along = _ladder_rungs(fixed_period), _ladder_rungs(following)
        if not at_fixed and not along:
            return None
        truth = [c for c in self.cells if c.reference and _close(c.control_period, period)]
        on_truth = self.entry(row, truth[0] if truth else self.truth)
        return Ladder(row, period, at_fixed, along, on_truth)

    @cached_property
    def _usual_period(self) -> float | None:
        periods = Counter(cell.control_period for cell in self.columns)
        return periods.most_common(1)[0][0] if periods else None

    @cached_property
    def checks(self) -> Mapping[str, tuple[Check, ...]]:
        """For every perturbation, the rows that met it; those that learned, if any did."""
        learned = [row for row in self.ordered_rows if row.learned is not False]
        return self._checks(learned) or self._checks(self.ordered_rows)

    def _checks(self, rows: Sequence[Row]) -> Mapping[str, tuple[Check, ...]]:
        checks: dict[str, list[Check]] = {}
        for row in rows:
            for cell in self.cells:
                after = self.entry(row, cell)
                if after is not None and after.success is not None and not cell.plain:
                    label = cell.perturbation or cell.name
                    checks.setdefault(label, []).append(Check(self._before(after), after))
        return {label: tuple(found) for label, found in checks.items()}

    def _before(self, after: Entry) -> Entry | None:
        """The same row and discretization without the perturbation."""
        cell = after.cell
        for other in self.cells:
            same = (other.engine, other.integrator) == (cell.engine, cell.integrator)
            steps = _close(other.dt, cell.dt) and _close(other.control_period, cell.control_period)
            if other.plain and same and steps:
                return self.entry(after.row, other)
        return None

    @cached_property
    def trust(self) -> tuple[Trust, ...]:
        """Every cell of the matrix that has a class against the reference, in column order."""
        found = []
        for cell in self.columns:
            if cell.reference:
                continue
            entries = (self.entry(row, cell) for row in self.ordered_rows)
            judged = tuple(e for e in entries if e is not None and e.reference_class)
            if judged:
                found.append(Trust(cell, judged))
        return tuple(found)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What to conclude from the classes against the reference, the surest first."""
        if self.truth is None:
            return (
                Finding(
                    "missing",
                    "There is no truth column here: this page shows where discretizations "
                    "disagree, not which of them is right.",
                ),
            )
        if not self.trust:
            return (
                Finding(
                    "missing",
                    "Nothing was compared with the reference here, so this panel cannot tell "
                    "false passes from true ones.",
                ),
            )
        judged = [entry for trust in self.trust for entry in trust.judged]
        passes = (self._false_passes(row) for row in self.ordered_rows)
        fails = (self._false_fails(trust) for trust in self.trust)
        found = [finding for finding in (*passes, *fails) if finding]
        found.sort(key=lambda finding: (finding.close, -len(finding.anchors)))
        return (self._agreement(judged), *found)

    def _agreement(self, judged: Sequence[Entry]) -> Finding:
        wrong = [e for e in judged if str(e.reference_class).startswith("false")]
        if not wrong:
            return Finding(
                "agreement",
                f"Every pass and every fail agrees with the reference, in all {len(judged)} "
                "pairs of policies and discretizations compared.",
            )
        counts = Counter(entry.reference_class for entry in wrong)
        parts = [
            plural(counts[kind], CLASS_WORDS[kind], more)
            for kind, more in (("false_pass", "false passes"), ("false_fail", "false fails"))
            if counts[kind]
        ]
        return Finding(
            "agreement",
            f"{len(judged) - len(wrong)} of {plural(len(judged), 'answer')} agree with the "
            f"reference; {' and '.join(parts)} do not.",
        )

    def _false_passes(self, row: Row) -> Finding | None:
        """Where a row that fails on the reference passes."""
        wrong = [e for trust in self.trust for e in trust.of("false_pass") if e.row == row]
        if not wrong:
            return None
        truth = self.entry(row, self.truth)
        at_home = next((entry for entry in wrong if entry.home and not row.mixed), None)
        others = _and([f"{e.cell.name} ({_rate(e)})" for e in wrong if e is not at_home], "cells")
        if at_home is None:
            text = f"{row.name} reaches {_rate(truth)} on the reference, but passes on {others}."
        else:
            text = (
                f"The policies trained on {row.name} reach {_rate(at_home)} at home but "
                f"{_rate(truth)} on the reference: that win belongs to the simulator, not to "
                "the physics."
            ) + (f" They also pass on {others}." if others else "")
        close = _undecided(truth) or any(_undecided(e) for e in ([at_home] if at_home else wrong))
        return Finding("false_pass", text, close, tuple(entry.anchor for entry in wrong))

    def _false_fails(self, trust: Trust) -> Finding | None:
        """What works on the reference and fails in one cell."""
        wrong = trust.of("false_fail")
        if not wrong:
            return None
        pairs = [f"{e.row.name} ({_rate(e)} against {_rate(self.on_truth(e))})" for e in wrong]
        rows = _and(pairs, "rows")
        text = (
            f"{trust.cell.name} fails what passes on the reference: {rows}. Judged there, "
            f"{'policies that work' if len(wrong) > 1 else 'a policy that works'} would be "
            "thrown away."
        )
        close = any(_undecided(entry) or _undecided(self.on_truth(entry)) for entry in wrong)
        return Finding("false_fail", text, close, tuple(entry.anchor for entry in wrong))

    def on_truth(self, entry: Entry) -> Entry | None:
        """The same row on the reference."""
        return self.entry(entry.row, self.truth)

    @cached_property
    def episodes(self) -> int:
        """Number of evaluation episodes in the panel."""
        return sum(entry.episodes or 0 for entry in self.entries.values())

    @cached_property
    def labels(self) -> Mapping[str, Mapping[str, int]]:
        """For every row with failures, how often each failure label was given."""
        counts: dict[str, Counter[str]] = {}
        for row in self.ordered_rows:
            total: Counter[str] = Counter()
            for cell in self.cells:
                entry = self.entry(row, cell)
                total.update({} if entry is None else entry.labels)
            total.pop("none", None)
            if sum(total.values()):
                counts[row.name] = total
        return counts

    @cached_property
    def failures_total(self) -> int:
        """Number of failed episodes: those with a label, or what the panel says of them."""
        counted = sum(sum(counts.values()) for counts in self.labels.values())
        return counted or int(finite(self.raw.get("failures_total")) or 0)

    @cached_property
    def created(self) -> str:
        """When the panel was made, to the minute."""
        text = self.text("created")
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            return text
        zone = "" if moment.tzinfo is None else " UTC"
        return f"{moment.astimezone(UTC) if zone else moment:%Y-%m-%d %H:%M}{zone}"

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What the reader must know before trusting anything here."""
        return tuple(str(text) for text in self.raw.get("warnings") or [])


def _row(index: int, raw: Json) -> Row:
    policies = tuple(_list(raw, "policies"))
    home = _text(raw.get("home"))
    steps = finite(raw.get("training_steps"))
    return Row(
        index=index,
        name=str(raw.get("name")),
        kind=str(raw.get("kind") or "trained"),
        homes=tuple(raw.get("shares") or ([] if home is None else [home])),
        integrator=_text(raw.get("integrator")),
        control_period=finite(raw.get("control_period")),
        seeds=int(finite(raw.get("seeds")) or len(policies)),
        home_success=estimate(raw.get("home_success")),
        learned=raw.get("learned"),
        training_steps=None if steps is None else int(steps),
        policies=policies,
    )


def _cell(index: int, raw: Json) -> Cell:
    return Cell(
        index=index,
        name=str(raw.get("name")),
        engine=str(raw.get("engine") or "native"),
        integrator=str(raw.get("integrator") or NONE),
        dt=finite(raw.get("dt")),
        control_period=finite(raw.get("control_period")),
        kind=str(raw.get("kind") or "grid"),
        perturbation=_text(raw.get("perturbation")),
        role=_text(raw.get("role")),
    )


def _count(value: Any) -> int | None:
    number = finite(value)
    return None if number is None else int(number)


def _entry(row: Row, cell: Cell, raw: Json) -> Entry:
    files = raw.get("file") or []
    rates = (finite(rate) for rate in raw.get("success_by_seed") or [])
    return Entry(
        row=row,
        cell=cell,
        episodes=_count(raw.get("episodes")),
        success=estimate(raw.get("success")),
        success_by_seed=tuple(rate for rate in rates if rate is not None),
        returns=estimate(raw.get("return")),
        time_to_success=estimate(raw.get("time_to_success")),
        time_to_success_episodes=_count(raw.get("time_to_success_episodes")),
        energy_residual=estimate(raw.get("energy_residual")),
        energy_residual_abs=estimate(raw.get("energy_residual_abs")),
        diverged=_count(raw.get("diverged")) or 0,
        not_converged=_count(raw.get("not_converged")) or 0,
        home_drop=estimate(raw.get("home_drop")),
        transfer_gap=estimate(raw.get("transfer_gap")),
        reference_class=_text(raw.get("reference_class")),
        labels=dict(raw.get("labels") or {}),
        files=(files,) if isinstance(files, str) else tuple(str(name) for name in files),
        query=_text(raw.get("query")),
    )


def _list(raw: Json, name: str) -> list[Json]:
    return list(raw.get(name) or [])


def _text(value: Any) -> str | None:
    return None if value is None else str(value)


def _by_name(items: Iterable[Any], kind: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for item in items:
        if item.name in found:
            raise ValueError(f"expected {kind} names that differ, got {item.name!r} twice")
        found[item.name] = item
    return found


def _coarse_first(cells: Iterable[Cell]) -> tuple[Cell, ...]:
    return tuple(sorted(cells, key=lambda cell: (-(cell.control_period or 0.0), -(cell.dt or 0.0))))


def _ladder_rungs(found: Mapping[str, list[Rung]]) -> dict[str, tuple[Rung, ...]]:
    """Ladders of at least two steps, each from coarse to fine."""
    ladders = {}
    for scheme, rungs in found.items():
        unique = {rung.dt: rung for rung in reversed(rungs)}
        if len(unique) > 1:
            ladders[scheme] = tuple(unique[dt] for dt in sorted(unique, reverse=True))
    return ladders


def _close(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return math.isclose(one, other, rel_tol=1e-9)


def _rate(entry: Entry | None) -> str:
    return NONE if entry is None or entry.success is None else fixed(entry.success.estimate)


def _undecided(entry: Entry | None) -> bool:
    """Whether the interval of the rate reaches across the line between pass and fail."""
    if entry is None or entry.success is None:
        return False
    low, high = entry.success.ends
    return low < PASS <= high


def _and(parts: Sequence[str], noun: str) -> str:
    """Names as a list in a sentence, cut where it gets too long to read."""
    named = list(parts)
    if len(parts) > _NAMED:
        named = [*parts[: _NAMED - 1], f"{len(parts) - _NAMED + 1} other {noun}"]
    if len(named) < 2:
        return "".join(named)
    return f"{', '.join(named[:-1])} and {named[-1]}"
