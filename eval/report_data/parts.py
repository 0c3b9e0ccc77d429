"""Rows, cells and entries of a panel's matrix, read from ``panel.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from integ_gym.eval.formatting import NONE, finite
from integ_gym.eval.report_data.estimate import Estimate, estimate

Json: TypeAlias = Mapping[str, Any]
"""A JSON object as `json.load` gives it."""

KIND_WORDS: Final = {
    "trained": "trained on",
    "given": "given policies",
    "baseline": "baselines",
}
"""Headings of the matrix's blocks of rows, in order."""


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
    def block(self) -> str:
        """The block of rows that it stands in, one of `KIND_WORDS`."""
        return self.kind if self.kind in KIND_WORDS else "given"

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
    def contradicted(self) -> bool:
        """Whether the reference contradicts its pass or fail."""
        return self.reference_class in ("false_pass", "false_fail")

    @property
    def anchor(self) -> str:
        """Name of the entry's place in the report."""
        return f"r{self.row.index}c{self.cell.index}"


@dataclass(frozen=True)
class Group:
    """Neighbouring columns: one integrator from its coarsest step to its finest."""

    label: str
    cells: tuple[Cell, ...]
    reference: bool = False


def read_row(index: int, raw: Json) -> Row:
    """One row, the ``index``-th of the panel."""
    policies = tuple(objects(raw, "policies"))
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


def read_cell(index: int, raw: Json) -> Cell:
    """One cell, the ``index``-th of the panel."""
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


def read_entry(row: Row, cell: Cell, raw: Json) -> Entry:
    """One entry of the matrix."""
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


def _count(value: Any) -> int | None:
    number = finite(value)
    return None if number is None else int(number)


def objects(raw: Json, name: str) -> list[Json]:
    """A list of objects, empty where it is missing or null."""
    return list(raw.get(name) or [])


def _text(value: Any) -> str | None:
    return None if value is None else str(value)


def close(one: float | None, other: float | None) -> bool:
    """Whether two times, s, are the same up to rounding, or both unknown."""
    if one is None or other is None:
        return one is other
    return math.isclose(one, other, rel_tol=1e-9)
