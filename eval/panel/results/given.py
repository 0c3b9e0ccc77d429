"""Rows of an evaluation: a policy that was given, and the baselines that it is held against."""

from __future__ import annotations

from ..specification import Cell, Home, PanelSpec, main_home
from .findings import paired_episodes, paired_remark
from .layout import PanelLayout
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


def given_remark(spec: PanelSpec, layout: PanelLayout, matrix: Matrix) -> str:
    """Returns of the policy, and how it does beside home or the truth, in sentences."""
    paired, row = paired_episodes(layout, matrix), layout.rows[0]
    compared = paired_remark(paired, compares_success(spec, matrix, row.name))
    told = (_unmet(spec, row, matrix), _returns(spec, row, matrix), compared)
    return " ".join(part for part in told if part)


def compares_success(spec: PanelSpec, matrix: Matrix, row: str) -> bool:
    """Whether success tells how a policy does; where it never succeeds, returns do."""
    succeeds = any(matrix.rates(row, cell.name).any() for cell in spec.columns())
    return spec.reference is not None and succeeds


def _unmet(spec: PanelSpec, row: Row, matrix: Matrix) -> str:
    """That the goal is never met, or not at home; nothing where it is.

    Where there is no truth, returns are compared, and may well have been learned for.
    """
    if spec.reference is None:
        return ""
    home, goal = matrix.home_rates(row.name), f'the goal "{spec.testbed.success.goal}"'
    if not any(matrix.rates(row.name, cell.name).any() for cell in spec.columns()):
        return f"It never meets {goal}, so nothing can be concluded of its success."
    return f"At home it never meets {goal}." if home is not None and not home.any() else ""


def _returns(spec: PanelSpec, row: Row, matrix: Matrix) -> str:
    """The range of the policy's returns in one sentence."""
    home = home_cell(row.trained_on)
    cells = [cell.name for cell in spec.columns()]
    means = {name: float(matrix.units(row.name, name, "return").mean()) for name in cells}
    low, high = min(means, key=lambda n: means[n]), max(means, key=lambda n: means[n])
    if means[low] == means[high]:
        return f"Its mean return is {means[low]:.1f} on each of them."
    at_home = ""
    if home is not None:
        spread = float(matrix.values(row.name, home, "return").std())
        at_home = f"{means[home]:.1f} at home (standard deviation {spread:.1f}), and "
    return (
        f"Its mean return is {at_home}between {means[low]:.1f} ({low}) and {means[high]:.1f} "
        f"({high})."
    )
