"""Evidence reduced to a matrix: rates, returns and residuals of every row in every cell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from integ_gym.envs.foreign import ASSUMED_RATE
from integ_gym.envs.ops.ops import Array
from integ_gym.evidence.labels import SENTENCE_COLUMNS, failure_sentence
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError

from .. import statistics as stats
from .. import verdict as rules
from ..power import Comparison
from .achieve import Tried
from .cells import AppliedDiscretization, Cell, Home, cell_at, main_home
from .contracts import Contracts, is_kept
from .limit import PARTS, AtLimit, extrapolate, widen
from .result import Entry, Failure, Limit, Look, Measure, Policy, Row
from .run_directory import Seen, looks_before, spent_by
from .spec import PanelSpec

COLUMNS = (
    "policy_id", "cell", "episode_index", "record_id", "success", '"return"', "time_to_success",
    "energy_residual_total", "energy_residual_abs_total", "solver_status", "failure_label",
    "replay_second_horizon", "arrival_energy", "arrival_residual", "command_error",
    *SENTENCE_COLUMNS,
    "(arguments->>'$.duration.value')::DOUBLE AS duration",
)  # fmt: skip
"""Columns of the records that the matrix is made of."""


class Matrix:
    """Outcomes by row and cell.

    The unit of replication is the training seed; of a baseline, of a policy that was given, and of
    what that is held against, the episode: numbers are about this policy and these starts.

    Args:
        rows: the panel's rows.
        records: one mapping per evaluation record, with at least :data:`COLUMNS`.
        episodes: paired starts per policy and cell.
        trace_every: which of them have a trace.

    Raises:
        ValueError: if a policy's episodes in a cell are not exactly 0 … episodes - 1.
    """

    def __init__(
        self,
        rows: Sequence[Row],
        records: Sequence[Mapping[str, Any]],
        episodes: int,
        trace_every: int = 1,
    ) -> None:
        self.rows = {row.name: row for row in rows}
        self.episodes = episodes
        self.trace_every = trace_every
        self._by_episode = any(row.kind == "given" for row in rows)
        self._records: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
        for record in records:
            key = (record["policy_id"], record["cell"])
            self._records.setdefault(key, []).append(record)
        for key, group in self._records.items():
            group.sort(key=lambda record: record["episode_index"])
            if [record["episode_index"] for record in group] != list(range(episodes)):
                raise InputError(f"episodes of {key[0]} in {key[1]} are not 0 … {episodes - 1}")

    def has(self, row: str, cell: str) -> bool:
        """Whether every policy of the row was evaluated in the cell."""
        return all((policy, cell) in self._records for policy in self.rows[row].policy_ids)

    def records(self, row: str, cell: str) -> list[list[Mapping[str, Any]]]:
        """Records by seed, then by episode."""
        return [self._records[policy, cell] for policy in self.rows[row].policy_ids]

    def values(self, row: str, cell: str, name: str) -> Array:
        """One column, shape (seeds, episodes); NaN where it is null."""
        table = [[record[name] for record in group] for group in self.records(row, cell)]
        return np.array(table, dtype=np.float64)

    def units(self, row: str, cell: str, name: str) -> Array:
        """One column by unit of replication, shape (units, episodes of each)."""
        return self._by_unit(row, self.values(row, cell, name))

    def _by_unit(self, row: str, values: Array) -> Array:
        """Values of shape (seeds, episodes) by unit of replication."""
        by_episode = self._by_episode or self.rows[row].kind == "baseline"
        return values.reshape(-1, 1) if by_episode else values

    def rates(self, row: str, cell: str) -> Array:
        """Success rate of every unit, shape (units,)."""
        return self.means(row, cell, "success")

    def means(self, row: str, cell: str, measure: Measure) -> Array:
        """Mean of every unit, shape (units,)."""
        values = self.units(row, cell, "success" if measure == "success" else "return")
        if measure != "success":
            values = values / self.units(row, cell, "duration")
        return np.asarray(values.mean(axis=1))

    def recovered_rates(self, row: str, cell: str) -> Array:
        """Success rate of every unit within one horizon or two, shape (units,)."""
        later = np.nan_to_num(self.units(row, cell, "replay_second_horizon"))
        return np.asarray(np.maximum(self.units(row, cell, "success"), later).mean(axis=1))

    def home_rates(self, row: str) -> Array | None:
        """Success rate of every unit at home, shape (units,), or None without a home.

        Of a mixture: the mean over its members by their shares, which is the rate in the
        distribution that it was trained on.
        """
        shares = self.rows[row].shares
        if not shares or not all(self.has(row, cell) for cell in shares):
            return None
        parts = [share * self.rates(row, cell) for cell, share in shares.items()]
        return np.asarray(np.clip(np.sum(parts, axis=0), 0.0, 1.0))

    def learned(self, row: str) -> bool | None:
        """Whether a row succeeds at home; None without a home."""
        home = self.home_rates(row)
        return None if home is None else bool(home.mean() >= rules.LEARNED)

    def entry(
        self,
        row: str,
        cell: str,
        native: str | None,
        reference: str | None,
        loss: rules.Loss | None = None,
        file: Sequence[str] = (),
        query: str = "",
    ) -> Entry:
        """Everything that the panel says about one row in one cell.

        Args:
            row: row name.
            cell: cell name.
            native: the row that was trained in this cell, if there is one.
            reference: name of the reference cell, or None where the cell's plant or control
                period is another.
            loss: of success against home, with its parts; None at home and without one.
            file: evidence files that hold the records.
            query: command that lists them.
        """
        records = [record for group in self.records(row, cell) for record in group]
        rates = self.rates(row, cell)
        return Entry(
            row=row,
            cell=cell,
            episodes=len(records),
            success=mean_success(rates),
            success_by_seed=tuple(self.values(row, cell, "success").mean(axis=1).tolist()),
            recovered=mean_success(self.recovered_rates(row, cell)),
            returns=self._mean_return(row, self.values(row, cell, "return")),
            time_to_success=self._mean(row, cell, "time_to_success"),
            time_to_success_episodes=sum(r["time_to_success"] is not None for r in records),
            energy_residual=self._mean(row, cell, "energy_residual_total"),
            energy_residual_abs=self._mean(row, cell, "energy_residual_abs_total"),
            numerics_share=self._numerics_share(row, cell),
            command_error=self._mean(row, cell, "command_error"),
            terminated=sum(record["terminated"] for record in records),
            diverged=sum(record["solver_status"] == "diverged" for record in records),
            not_converged=sum(r["solver_status"] == "not_converged" for r in records),
            home_drop=None if loss is None else loss.total,
            difficulty=None if loss is None else loss.difficulty,
            deadline=None if loss is None else loss.deadline,
            overfitting=None if loss is None else loss.overfitting,
            **({} if loss is None else self._tail(row, cell)),
            transfer_gap=self._transfer_gap(row, cell, native),
            reference_class=self._reference_class(row, cell, reference),
            labels=dict(Counter(record["failure_label"] for record in records)),
            file=tuple(file),
            query=query,
        )

    def failures(self, row: str, cell: str) -> list[Failure]:
        """Failed episodes, with their labels and reasons."""
        return [
            Failure(
                row=row,
                cell=cell,
                policy=record["policy_id"],
                episode_index=record["episode_index"],
                record_id=record["record_id"],
                label=record["failure_label"],
                reason=failure_sentence(record),
            )
            for group in self.records(row, cell)
            for record in group
            if not record["success"]
        ]

    def has_trace(self, episode_index: int) -> bool:
        """Whether an episode's trace is kept."""
        return episode_index % self.trace_every == 0

    def at_limit(self, row: str, steps: Sequence[str], order: int, close: float) -> AtLimit:
        """Outcomes of a row at the limit.

        Args:
            row: row name.
            steps: the limit's cells, the coarsest first.
            order: of their integrator.
            close: see :func:`extrapolate`.
        """
        success, returns = (
            [self.values(row, cell, name) for cell in steps] for name in ("success", "return")
        )
        return extrapolate(success, returns, order, close)

    def limit(self, row: str, steps: Sequence[str], order: int, close: float) -> Limit:
        """What a row reaches at the limit; arguments as of :meth:`at_limit`."""
        found, cell = self.at_limit(row, steps, order, close), steps[-1]
        returns = self._mean_return(row, found.returns)
        return Limit(
            row=row,
            cell=cell,
            steps=tuple(steps),
            order=order,
            episodes=found.changed.size,
            changed_before=found.changed_before,
            not_converged=int(found.changed.sum()),
            success=widen(mean_success(self.rates(row, cell)), found.success_slack, 0.0),
            success_slack=found.success_slack,
            returns=widen(returns, found.return_slack, -np.inf, np.inf),
        )

    def _mean_return(self, row: str, returns: Array) -> stats.Estimate | None:
        values = self._by_unit(row, returns)
        if not np.isfinite(values).all():
            return None
        if self._by_episode:
            return _unit_mean(values)
        return stats.iqm_interval(values) or stats.Estimate(stats.iqm(values))

    def _numerics_share(self, row: str, cell: str) -> stats.Estimate | None:
        """Of the energy gained until the goal is first reached, what numerical error put in."""
        success, energy, residual = (
            self.units(row, cell, name)
            for name in ("success", "arrival_energy", "arrival_residual")
        )
        gained = (success > 0.0) & (energy > 0.0)
        share = np.divide(residual, energy, out=np.full_like(energy, np.nan), where=gained)
        return _unit_mean(share)

    def _tail(self, row: str, cell: str) -> dict[str, Any]:
        """How many seeds lose most of their success, and which loses most."""
        home = self.home_rates(row)
        if home is None or cell == self.rows[row].home or self._by_episode:
            return {}
        lost = home - self.rates(row, cell)
        worst = int(np.argmax(lost))
        return {
            "tail": stats.rate_interval((lost > rules.TAIL).astype(np.float64)),
            "worst_policy": self.rows[row].policy_ids[worst],
            "worst_loss": float(lost[worst]),
        }

    def _mean(self, row: str, cell: str, name: str) -> stats.Estimate | None:
        """Mean over units of each unit's mean over its episodes that have a value."""
        return _unit_mean(self.units(row, cell, name))

    def _transfer_gap(self, row: str, cell: str, native: str | None) -> stats.Estimate | None:
        if native is None or native == row or self.rows[row].kind == "baseline":
            return None
        return stats.unpaired_difference(self.rates(native, cell), self.rates(row, cell)).interval

    def _reference_class(
        self, row: str, cell: str, reference: str | None
    ) -> rules.ReferenceClass | None:
        if reference in (None, cell) or not self.has(row, str(reference)):
            return None
        return rules.reference_class(
            self.rates(row, cell).mean(), self.rates(row, str(reference)).mean()
        )


def _unit_mean(values: Array) -> stats.Estimate | None:
    """Mean over units of each unit's mean over its finite values; None without any."""
    present = np.isfinite(values)
    means = [float(v[p].mean()) for v, p in zip(values, present, strict=True) if p.any()]
    return stats.mean_interval(means) or stats.Estimate(means[0]) if means else None


def mean_success(rates: Array) -> stats.Estimate:
    """A mean success rate over units of replication."""
    return stats.rate_interval(rates, draws=stats.draws_for(len(rates)))


@dataclass(frozen=True)
class PanelLayout:
    """Rows and cells of a panel, and what was declared about them.

    Attributes:
        rows: all rows.
        cells: all cells by name.
        cells_of: names of the cells that a row was evaluated in.
        reference: name of the reference cell; None where the plant has no reference.
        family: declared comparisons (row, cell).
        compare: declared pairs of rows.
        looks: every look at the verdicts so far, this one included.
        looks_before: those before this one, and those that were planned.
        tried: what a hand-made controller and a search reach, by cell.
        applied: what the cells' environments really did, by cell.
        contracts: what was compared of homes and cells on other engines.
        check: see :class:`PanelSpec`.
    """

    rows: tuple[Row, ...]
    cells: Mapping[str, Cell]
    cells_of: Mapping[str, tuple[str, ...]]
    reference: str | None
    family: Sequence[tuple[str, str]] = ()
    compare: Sequence[tuple[str, str]] = ()
    looks: tuple[Look, ...] = ()
    looks_before: rules.Looks = field(default_factory=rules.Looks)
    tried: Mapping[str, Tried] = field(default_factory=dict)
    applied: Mapping[str, AppliedDiscretization] = field(default_factory=dict)
    contracts: Contracts = field(default_factory=dict)
    check: bool = False

    @classmethod
    def of(
        cls,
        spec: PanelSpec,
        rows: tuple[Row, ...],
        homes: Mapping[str, Home],
        tried: Mapping[str, Tried],
        applied: Mapping[str, AppliedDiscretization],
        looks: Sequence[Seen] = (),
        contracts: Contracts | None = None,
    ) -> PanelLayout:
        """Rows of a panel with the cells that each is evaluated in.

        Args:
            spec: the panel.
            rows: its rows.
            homes: what rows were trained on, by name, as far as that is known.
            tried: see the class.
            applied: see the class.
            looks: every look at the verdicts so far, this one included.
            contracts: see the class.
        """
        own = {row.name: spec.cells_of(homes.get(row.name)) for row in rows}
        every = [*spec.columns(), *(cell for cells in own.values() for cell in cells)]
        return cls(
            rows=rows,
            cells={cell.name: cell for cell in every},
            cells_of={row: tuple(cell.name for cell in cells) for row, cells in own.items()},
            reference=next((c.name for c in every if c.kind == "reference"), None),
            family=spec.family,
            compare=spec.compare,
            looks=_looks(looks, spec.looks),
            looks_before=looks_before(looks[:-1], spec.looks)[-1],
            tried=tried,
            applied=applied,
            contracts=contracts or {},
            check=spec.check,
        )

    @property
    def looks_so_far(self) -> rules.Looks:
        """All looks so far, this one included."""
        return self.looks_before.then(self.looks[-1].seeds) if self.looks else self.looks_before

    @property
    def share(self) -> float:
        """Of the level, what this look has for comparisons of two rows."""
        if not self.looks:
            return rules.FIRST_SHARE
        return self.looks_before.shares(self.looks[-1].seeds).exceeds

    def native(self, cell: str) -> str | None:
        """The row that was trained in a cell alone, if there is one."""
        return next((row.name for row in self.rows if row.home == cell), None)

    def reference_of(self, matrix: Matrix, cell: str, called: Sequence[str]) -> str | None:
        """The truth, or without one the limit, at a cell's control period.

        None where something is varied in the cell, or it cannot be solved in time, so that failing
        there says nothing.

        Args:
            matrix: outcomes.
            cell: name of the cell.
            called: cells that are called a limit, see :func:`limits_called`.
        """
        own = self.cells[cell]
        if own.kind in ("varied", "ladder", "limit"):
            return None
        if self.achieved(matrix, cell).status in rules.UNSOLVABLE:
            return None
        exact: Iterable[Cell] = (cell for cell in self.cells.values() if cell.reference)
        finest = map(self.cells.__getitem__, called)
        found = cell_at(finest if self.reference is None else exact, own.control_period)
        return None if found is None else found.name

    def columns(self) -> tuple[str, ...]:
        """Names of the cells that every row is evaluated in."""
        return tuple(name for name, cell in self.cells.items() if cell.column)

    def limit_steps(self) -> tuple[tuple[str, ...], ...]:
        """Names of the limit's steps at each of its control periods, the coarsest first."""
        found: dict[float, dict[int, str]] = {}
        for cell in self.cells.values():
            if cell.limit_part is not None:
                found.setdefault(cell.control_period, {})[cell.limit_part] = cell.name
        return tuple(tuple(own[part] for part in PARTS) for own in found.values())

    def rates(self, matrix: Matrix, row: str, cell: str) -> rules.Rates | None:
        """What the loss of a row in a cell is made of; None without a home."""
        native, home = self.native(cell), matrix.home_rates(row)
        if home is None:
            return None
        return rules.Rates(
            home,
            matrix.rates(row, cell),
            matrix.recovered_rates(row, cell),
            None if native in (None, row) else matrix.recovered_rates(str(native), cell),
            self._tried(cell).recovered or None,
        )

    def loss(self, matrix: Matrix, row: str, cell: str) -> rules.Loss | None:
        """The loss of a row in a cell; None at home and without one."""
        rates = self.rates(matrix, row, cell)
        if rates is None or cell == matrix.rows[row].home:
            return None
        parts = rules.split(rates)
        if self.check:
            parts = replace(parts, total=rules.checked_loss(rates.home, rates.transferred))
        return parts

    def losses(self, matrix: Matrix) -> dict[tuple[str, str], rules.Loss]:
        """Every loss that there is, by row and cell."""
        places = [(row.name, cell) for row in self.rows for cell in self.cells_of[row.name]]
        found = {place: self.loss(matrix, *place) for place in places}
        return {place: loss for place, loss in found.items() if loss is not None}

    def achieved(self, matrix: Matrix, cell: str) -> rules.Achieved:
        """Whether a cell can be solved: by any policy, or by what was tried before."""
        attempts = []
        for row in self.rows:
            if row.kind != "baseline" and matrix.has(row.name, cell):
                rates = matrix.rates(row.name, cell), matrix.recovered_rates(row.name, cell)
                attempts.append(rules.Attempt(row.name, *(float(rate.mean()) for rate in rates)))
        return self._tried(cell).achieved(*attempts)

    def comparison(self, matrix: Matrix, row: str, cell: str) -> Comparison:
        """The transfer of a row with a home to a cell, as it is judged."""
        rates = self.rates(matrix, row, cell)
        assert rates is not None
        achieved = self.achieved(matrix, cell)
        return Comparison(row, cell, rates, achieved, self.contract_kept(row, cell))

    @cached_property
    def broken(self) -> frozenset[tuple[str, str]]:
        """Rows and cells that differ from home before any integration: nothing is judged there."""
        places = ((row.name, cell) for row in self.rows for cell in self.cells_of[row.name])
        return frozenset(place for place in places if self.contract_kept(*place) is False)

    def contract_kept(self, row: str, cell: str) -> bool | None:
        """Whether a cell keeps the contract of a row's home; None: not compared."""
        shares = next(one.shares for one in self.rows if one.name == row)
        homes = [self.cells[name].discretization for name in shares]
        return is_kept(self.contracts, homes, self.cells[cell])

    def _tried(self, cell: str) -> Tried:
        return self.tried.get(cell, Tried())


def _looks(seen: Sequence[Seen], planned: Sequence[int]) -> tuple[Look, ...]:
    """Looks with the levels that they spend, from what there was at each."""
    return tuple(
        Look(
            seeds=look.seeds,
            episodes=look.episodes,
            natives=look.natives,
            level_exceeds=own.levels[0],
            level_equivalent=own.levels[1],
            adopted=look.spent is not None,
        )
        for look, own in zip(seen, spent_by(seen, planned), strict=True)
    )


_SAY_IT = (
    "does not say what its rewards are, so that a decision pays their mean, and of an episode's "
    'last step the whole; give `held` rewards="rate", "sum" or "last"'
)

_ASSUMED = f"phase = 'evaluation' AND engine_description LIKE '%{ASSUMED_RATE}%'"

_REPEATED = f"SELECT record_id FROM records WHERE {_ASSUMED} AND substeps > 1 LIMIT 1"

_LAST = f"""
SELECT * FROM (
    SELECT reward[length] AS last, list_min(reward[:length - 1]) AS least,
        list_max(reward[:length - 1]) AS most
    FROM records
    WHERE {_ASSUMED} AND terminated AND reward IS NOT NULL AND length > 1
)
WHERE abs(last) > 2.0 * greatest(abs(least), abs(most))
    OR (last < 0.0 AND least > 0.0) OR (last > 0.0 AND most < 0.0)
ORDER BY abs(last) DESC LIMIT 1
"""
"""The reward with which an episode ended that is most unlike those before it, if there is one."""

_PAID = f"""
SELECT policy_id, engine, integrator, control_period, dt,
    sum(list_sum(reward[:length - 1])) / sum(length - 1) AS paid
FROM records
WHERE {_ASSUMED} AND perturbation IS NULL AND reward IS NOT NULL AND length > 1
GROUP BY ALL
"""
"""Mean reward of a decision, the last of each episode left out."""

_CLOSE = 0.2
"""How far, relatively, rewards may be from being proportional to the step."""


def reward_doubts(env_id: str, records: EvidenceStore) -> tuple[str, ...]:
    """A doubt where rewards were taken for rates because the testbed does not say what they are.

    Two things speak against it: a step that ends an episode pays what is of another kind than all
    before it (more than twice as large, or of the other sign), and rewards that shrink in
    proportion to the step.

    Args:
        env_id: of the testbed.
        records: of a panel.
    """
    if not records.query(_REPEATED).num_rows:
        return ()
    found = [*_unlike_the_others(records), *_proportional_to_the_step(records)]
    return (f"{'; '.join(found)}; and {env_id} {_SAY_IT}",) if found else ()


def _unlike_the_others(records: EvidenceStore) -> Iterator[str]:
    for row in records.query(_LAST).to_pylist():
        least, most = f"{row['least']:.3g}", f"{row['most']:.3g}"
        others = least if least == most else f"{least} to {most}"
        yield (
            f"the reward of the decision that ends an episode ({row['last']:.3g}) is of another "
            f"kind than those before it ({others})"
        )


def _proportional_to_the_step(records: EvidenceStore) -> Iterator[str]:
    """One sentence, if every policy's rewards shrink as the step does."""
    paid: dict[tuple[Any, ...], dict[float, float]] = {}
    for row in records.query(_PAID).to_pylist():
        alike = tuple(row[n] for n in ("policy_id", "engine", "integrator", "control_period"))
        paid.setdefault(alike, {})[row["dt"]] = row["paid"]
    found = []
    for (policy, *_), by_step in sorted(paid.items()):
        fine, coarse = min(by_step), max(by_step)
        if fine < coarse and by_step[coarse]:
            ratio = by_step[fine] / by_step[coarse] * coarse / fine
            found.append((abs(ratio - 1.0), policy, fine, coarse, by_step))
    if not found or max(off for off, *_ in found) > _CLOSE:
        return
    _, policy, fine, coarse, by_step = found[0]
    yield (
        f"rewards shrink with `dt` as amounts do that are scaled by it: a decision of {policy} "
        f"earns {by_step[coarse]:.3g} at dt {coarse:g} s and {by_step[fine]:.3g} at dt {fine:g} s"
    )


def read_applied(store: EvidenceStore) -> dict[str, AppliedDiscretization]:
    """What was applied, by cell, from the records of evaluations.

    Raises:
        ValueError: if the records of a cell do not agree.
    """
    names = ", ".join(AppliedDiscretization.__struct_fields__)
    rows = store.query(f"SELECT DISTINCT cell, {names} FROM records WHERE phase = 'evaluation'")
    found: dict[str, AppliedDiscretization] = {}
    for row in rows.to_pylist():
        cell = row.pop("cell")
        if cell in found:
            raise InputError(f"records of cell {cell!r} do not agree on {names}")
        found[cell] = AppliedDiscretization(**row)
    return found


def given_rows(
    spec: PanelSpec, policy: Policy, home: Home | None
) -> tuple[tuple[Row, ...], dict[str, Home]]:
    """The policy's row, then the baselines'; and the home, if it is known, by row.

    Args:
        spec: of the evaluation.
        policy: that was given.
        home: what it was trained on; None: unknown.
    """
    rows = (
        Row.of(policy.id, "given", [policy], home, spec.shares_of(home)),
        *(Row.of(name, "baseline", [Policy(id=name)]) for name in spec.baselines),
    )
    return rows, {} if home is None else {policy.id: home}


def home_cell(spec: PanelSpec, home: Home | None) -> str | None:
    """Name of the cell that most of the training ran on; None: unknown."""
    main = main_home(home)
    return None if main is None else spec.name_of(main)


def compares_success(spec: PanelSpec, matrix: Matrix, row: str) -> bool:
    """Whether success tells how a policy does; where it never succeeds, returns do."""
    succeeds = any(matrix.rates(row, cell.name).any() for cell in spec.columns())
    return spec.reference is not None and succeeds
