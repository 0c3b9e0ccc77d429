"""Rows of an evaluation: a policy that was given, and the baselines that it is held against."""

from __future__ import annotations

from ..specification.cells.cell import Cell, Home, main_home
from ..specification.panel_spec import PanelSpec
from .matrix import Matrix, Row


def given_rows(spec: PanelSpec, policy: str, home: Home | None) -> tuple[Row, ...]:
    """The policy's row, then the baselines'.

    Args:
        spec: of the evaluation.
        policy: its id.
        home: what it was trained on; None: unknown.
    """
    return (
        Row(policy, "given", (policy,), home),
        *(Row(name, "baseline", (name,)) for name in spec.baselines),
    )


def home_cell(home: Home | None) -> str | None:
    """Name of the cell that most of the training ran on; None: unknown."""
    main = main_home(home)
    return None if main is None else Cell(main, "grid").name


def compares_success(spec: PanelSpec, matrix: Matrix, row: str) -> bool:
    """Whether success tells how a policy does; where it never succeeds, returns do."""
    succeeds = any(matrix.rates(row, cell.name).any() for cell in spec.columns())
    return spec.reference is not None and succeeds
