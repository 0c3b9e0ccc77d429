"""Would judging in a cell have chosen the policies that are best on the truth?"""

from __future__ import annotations

import numpy as np

from ....statistics import ranking_intervals
from ...model.conclusions import RankingAgreement
from ...model.part import Estimate
from ..layout import PanelLayout
from ..matrix import Matrix, Row

FEWEST = 5
"""Policies below which nothing is said of their ranking."""


def rankings(layout: PanelLayout, matrix: Matrix) -> tuple[RankingAgreement, ...]:
    """Agreement of every column's ranking of the trained policies with the truth's."""
    truth = layout.reference
    rows = [row for row in layout.rows if row.kind == "trained"]
    if truth is None or sum(len(row.policies) for row in rows) < FEWEST:
        return ()
    return tuple(_ranking(matrix, rows, cell, truth) for cell in layout.columns() if cell != truth)


def _ranking(matrix: Matrix, rows: list[Row], cell: str, truth: str) -> RankingAgreement:
    here = {row.name: matrix.rates(row.name, cell) for row in rows}
    there = {row.name: matrix.rates(row.name, truth) for row in rows}
    seeds = np.concatenate([np.arange(len(rates)) for rates in here.values()])
    correlation, violation = ranking_intervals(
        np.concatenate(list(here.values())), np.concatenate(list(there.values())), seeds
    )
    chosen = max(here, key=lambda name: float(here[name].mean()))
    best = max(there, key=lambda name: float(there[name].mean()))
    return RankingAgreement(
        cell=cell,
        policies=len(seeds),
        correlation=None if correlation is None else Estimate.of(correlation),
        violation=Estimate.of(violation),
        chosen=chosen,
        best=best,
        regret=float(there[best].mean() - there[chosen].mean()),
    )
