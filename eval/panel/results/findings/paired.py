"""Given policies held against themselves: the same starts in a cell and at home."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
import numpy.typing as npt

from ....statistics import holm, paired_return, paired_success
from ....verdict import adjust_for_look, share_of_look
from ...model.conclusions import PairedEpisodes
from ...model.part import Estimate
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
    share = share_of_look(max(1, len(layout.looks)))
    adjusted = [adjust_for_look(p, share) for p in holm([p for _, p in rates]).tolist()]
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
            p_return_adjusted=own and adjust_for_look(next(corrected), share),
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
