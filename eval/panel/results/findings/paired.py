"""Given policies held against themselves: the same starts in a cell and at home."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
import numpy.typing as npt

from ....statistics import holm, paired_return, paired_success
from ....verdict import ALPHA, p_text
from ...model import Estimate, PairedEpisodes
from ..layout import PanelLayout
from ..matrix import Matrix, Row

Array = npt.NDArray[np.float64]


def paired_episodes(layout: PanelLayout, matrix: Matrix) -> tuple[PairedEpisodes, ...]:
    """What every given policy does in each cell, beside home; beside the truth without a home."""
    given = [row for row in layout.rows if row.kind == "given"]
    return tuple(found for row in given for found in _paired(layout, matrix, row))


def _paired(layout: PanelLayout, matrix: Matrix, row: Row) -> Iterator[PairedEpisodes]:
    cells = layout.cells_of[row.name]
    against, shares = _held_against(layout, matrix, row)
    if against is None:
        return
    tested = [cell for cell in cells if cell not in shares or len(shares) > 1]
    success = _mixed(matrix, row.name, "success", shares)
    earned = _mixed(matrix, row.name, "return", shares)
    rates = [paired_success(success, _of(matrix, row.name, "success", cell)) for cell in tested]
    means = [_return(earned, _of(matrix, row.name, "return", cell)) for cell in tested]
    adjusted = holm([p for _, p in rates]).tolist()
    known = [p for found in means if found for p in found[1:]]
    corrected = iter(holm(known).tolist())
    for cell, (interval, p), own, p_adjusted in zip(tested, rates, means, adjusted, strict=True):
        yield PairedEpisodes(
            row=row.name,
            cell=cell,
            against=against,
            episodes=len(success),
            success=Estimate.of(interval),
            p_success=p,
            p_success_adjusted=p_adjusted,
            returns=own and own[0],
            p_return=own and own[1],
            p_return_adjusted=own and next(corrected),
        )


def _held_against(
    layout: PanelLayout, matrix: Matrix, row: Row
) -> tuple[Literal["home", "truth"] | None, dict[str, float]]:
    """What a row is held against, as shares of cells; None where there is nothing."""
    if row.shares and all(matrix.has(row.name, cell) for cell in row.shares):
        return "home", row.shares
    return (None, {}) if layout.reference is None else ("truth", {layout.reference: 1.0})


def _of(matrix: Matrix, row: str, name: str, cell: str) -> Array:
    """One column by start."""
    values: Array = matrix.values(row, cell, name)[0]
    return values


def _mixed(matrix: Matrix, row: str, name: str, shares: dict[str, float]) -> Array:
    """One column by start, averaged over cells by their shares."""
    parts = [share * _of(matrix, row, name, cell) for cell, share in shares.items()]
    mean: Array = np.sum(parts, axis=0)
    return np.clip(mean, 0.0, 1.0) if name == "success" else mean


def _return(there: Array, here: Array) -> tuple[Estimate, float] | None:
    """Difference of mean returns and its p-value; None where a return is not finite."""
    if not (np.isfinite(there).all() and np.isfinite(here).all()):
        return None
    interval, p = paired_return(there, here)
    estimate = Estimate(float(np.mean(there - here)))
    return (estimate if interval is None else Estimate.of(interval)), p


def paired_remark(found: tuple[PairedEpisodes, ...], success: bool = True) -> str:
    """What the paired episodes show, in a sentence; nothing without any.

    Args:
        found: of one row.
        success: whether success is compared beside the return.
    """
    shown = [_shown(found, kind) for kind in ((True, False) if success else (False,))]
    told = "; ".join(filter(None, shown))
    if not told:
        return ""
    where = "at home" if found[0].against == "home" else "on the truth"
    return f"This policy, these {found[0].episodes} starts, against what it does {where}: {told}."


def _shown(found: tuple[PairedEpisodes, ...], success: bool) -> str:
    """On how many cells success, or the return, is shown to differ; nothing where not known."""
    known = [
        (one.cell, difference, p)
        for one in found
        for difference, p in [
            (one.success, one.p_success_adjusted)
            if success
            else (one.returns, one.p_return_adjusted)
        ]
        if difference is not None and p is not None
    ]
    if not known:
        return ""
    what = "success" if success else "the mean return"
    shown = [(cell, difference, p) for cell, difference, p in known if p < ALPHA]
    lower = sum(difference.estimate > 0.0 for _, difference, _ in shown)
    if not shown:
        return f"{what} is not shown to differ on any of {len(known)} cells"
    cell, difference, p = max(shown, key=lambda one: abs(one[1].estimate))
    change = "lower" if difference.estimate > 0.0 else "higher"
    return (
        f"{what} is lower on {lower} and higher on {len(shown) - lower} of {len(known)} "
        f"cells, and the most {change} on {cell}: by {_size(difference)}, adjusted {p_text(p)}"
    )


def _size(difference: Estimate) -> str:
    """Size of a difference with its interval."""
    ends = sorted(abs(end) for end in difference.ends)
    crossing = difference.ends[0] < 0.0 < difference.ends[1]
    interval = "" if crossing or not difference.bounded else f" ({ends[0]:.2f} to {ends[1]:.2f})"
    return f"{abs(difference.estimate):.2f}{interval}"
