"""The panel's matrix: evidence records reduced to rows × cells, with intervals over seeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.evidence.labels import SENTENCE_COLUMNS, failure_sentence

from ...statistics import (
    Interval,
    draws_for,
    iqm,
    iqm_interval,
    mean_interval,
    rate_interval,
    unpaired_difference,
)
from ...verdict import LEARNED, TAIL, Loss, ReferenceClass, reference_class
from ..model.conclusions import Failure
from ..model.matrix import Entry, RowKind
from ..model.part import Estimate
from ..specification.cells.cell import Home

Array = npt.NDArray[Any]

COLUMNS = (
    "policy_id", "cell", "episode_index", "record_id", "success", '"return"', "time_to_success",
    "energy_residual_total", "energy_residual_abs_total", "solver_status", "failure_label",
    "replay_second_horizon", "arrival_energy", "arrival_residual", *SENTENCE_COLUMNS,
)  # fmt: skip
"""Columns of the records that the matrix is made of."""


@dataclass(frozen=True)
class Row:
    """One row of the panel.

    Attributes:
        name: of the row.
        kind: `trained`, `baseline` or `given`.
        policies: policy ids, one per training seed.
        trained_on: discretization or mixture; None for what was not trained.
    """

    name: str
    kind: RowKind
    policies: tuple[str, ...]
    trained_on: Home | None = None

    @property
    def shares(self) -> dict[str, float]:
        """Share of each cell, by name, that it was trained in; empty for what was not trained."""
        members = {} if self.trained_on is None else self.trained_on.shares
        return {member.name: share for member, share in members.items()}

    @property
    def home(self) -> str | None:
        """Name of the home cell; None without one, or with the several of a mixture."""
        return next(iter(self.shares)) if len(self.shares) == 1 else None


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
                raise ValueError(f"episodes of {key[0]} in {key[1]} are not 0 … {episodes - 1}")

    def has(self, row: str, cell: str) -> bool:
        """Whether every policy of the row was evaluated in the cell."""
        return all((policy, cell) in self._records for policy in self.rows[row].policies)

    def records(self, row: str, cell: str) -> list[list[Mapping[str, Any]]]:
        """Records by seed, then by episode."""
        return [self._records[policy, cell] for policy in self.rows[row].policies]

    def values(self, row: str, cell: str, name: str) -> Array:
        """One column, shape (seeds, episodes); NaN where it is null."""
        table = [[record[name] for record in group] for group in self.records(row, cell)]
        return np.array(table, dtype=np.float64)

    def units(self, row: str, cell: str, name: str) -> Array:
        """One column by unit of replication, shape (units, episodes of each)."""
        values = self.values(row, cell, name)
        by_episode = self._by_episode or self.rows[row].kind == "baseline"
        return values.reshape(-1, 1) if by_episode else values

    def rates(self, row: str, cell: str) -> Array:
        """Success rate of every unit, shape (units,)."""
        means: Array = self.units(row, cell, "success").mean(axis=1)
        return means

    def recovered_rates(self, row: str, cell: str) -> Array:
        """Success rate of every unit within one horizon or two, shape (units,)."""
        later = np.nan_to_num(self.units(row, cell, "replay_second_horizon"))
        means: Array = np.maximum(self.units(row, cell, "success"), later).mean(axis=1)
        return means

    def home_rates(self, row: str) -> Array | None:
        """Success rate of every unit at home, shape (units,), or None without a home.

        Of a mixture: the mean over its members by their shares, which is the rate in the
        distribution that it was trained on.
        """
        shares = self.rows[row].shares
        if not shares or not all(self.has(row, cell) for cell in shares):
            return None
        parts = [share * self.rates(row, cell) for cell, share in shares.items()]
        mean: Array = np.clip(np.sum(parts, axis=0), 0.0, 1.0)
        return mean

    def learned(self, row: str) -> bool | None:
        """Whether a row succeeds at home; None without a home."""
        home = self.home_rates(row)
        return None if home is None else bool(home.mean() >= LEARNED)

    def entry(
        self,
        row: str,
        cell: str,
        native: str | None,
        reference: str | None,
        loss: Loss | None = None,
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
            success=_rate(rates),
            success_by_seed=tuple(self.values(row, cell, "success").mean(axis=1).tolist()),
            recovered=_rate(self.recovered_rates(row, cell)),
            returns=self._return(row, cell),
            time_to_success=self._mean(row, cell, "time_to_success"),
            time_to_success_episodes=sum(r["time_to_success"] is not None for r in records),
            energy_residual=self._mean(row, cell, "energy_residual_total"),
            energy_residual_abs=self._mean(row, cell, "energy_residual_abs_total"),
            numerics_share=self._numerics_share(row, cell),
            diverged=sum(record["solver_status"] == "diverged" for record in records),
            not_converged=sum(r["solver_status"] == "not_converged" for r in records),
            home_drop=None if loss is None else Estimate.of(loss.total),
            difficulty=None if loss is None else Estimate.of(loss.difficulty),
            deadline=None if loss is None else Estimate.of(loss.deadline),
            overfitting=None if loss is None else Estimate.of(loss.overfitting),
            **self._tail(row, cell),
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

    def _return(self, row: str, cell: str) -> Estimate | None:
        values = self.units(row, cell, "return")
        if not np.isfinite(values).all():
            return None
        if self._by_episode:
            return _unit_mean(values)
        return _estimate(iqm_interval(values), iqm(values))

    def _numerics_share(self, row: str, cell: str) -> Estimate | None:
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
            "tail": Estimate.of(rate_interval((lost > TAIL).astype(np.float64))),
            "worst_policy": self.rows[row].policies[worst],
            "worst_loss": float(lost[worst]),
        }

    def _mean(self, row: str, cell: str, name: str) -> Estimate | None:
        """Mean over units of each unit's mean over its episodes that have a value."""
        return _unit_mean(self.units(row, cell, name))

    def _transfer_gap(self, row: str, cell: str, native: str | None) -> Estimate | None:
        if native is None or native == row or self.rows[row].kind == "baseline":
            return None
        gap = unpaired_difference(self.rates(native, cell), self.rates(row, cell))
        return Estimate.of(gap.interval)

    def _reference_class(self, row: str, cell: str, reference: str | None) -> ReferenceClass | None:
        if reference in (None, cell) or not self.has(row, str(reference)):
            return None
        return reference_class(self.rates(row, cell).mean(), self.rates(row, str(reference)).mean())


def _unit_mean(values: Array) -> Estimate | None:
    """Mean over units of each unit's mean over its finite values; None without any."""
    present = np.isfinite(values)
    means = [float(v[p].mean()) for v, p in zip(values, present, strict=True) if p.any()]
    return _estimate(mean_interval(means), means[0]) if means else None


def _rate(rates: Array) -> Estimate:
    """A mean success rate over units of replication."""
    return Estimate.of(rate_interval(rates, draws=draws_for(len(rates))))


def _estimate(interval: Interval | None, alone: float) -> Estimate:
    """An estimate; one unit alone, which says nothing about others, has no interval."""
    return Estimate(float(alone)) if interval is None else Estimate.of(interval)
