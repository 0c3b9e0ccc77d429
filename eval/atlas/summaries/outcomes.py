"""What the atlas found for every training ground and limit of the control."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...panel.specification.cells.cell import Home
from ...verdict.rules import LEARNED
from ..specification import Atlas, Block
from .agreement import Agreement, check_agree
from .summary import Summary

Rates = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Point:
    """Policies of one training ground at one limit of the control.

    Attributes:
        ratio: limit of the control over the critical one of the truth.
        home: what they were trained on.
        seeds: training seeds.
        at_home: success rate there, shape (seeds,).
        on_truth: the same on the truth.
        recovered: the same within two horizons.
    """

    ratio: float
    home: Home
    seeds: tuple[int, ...]
    at_home: Rates
    on_truth: Rates
    recovered: Rates

    @property
    def learned(self) -> bool:
        """Whether the task was learned at home."""
        return bool(self.at_home.mean() >= LEARNED)


def points(
    atlas: Atlas, summaries: Sequence[tuple[Block, Summary]], agreements: Iterable[Agreement] = ()
) -> list[Point]:
    """One point for every ratio that was run and everything that was trained on.

    Args:
        atlas: what was run.
        summaries: of finished blocks.
        agreements: between the versions of the code that made them.

    Raises:
        ValueError: if versions of the code were never held against each other.
    """
    check_agree([summary for _, summary in summaries], agreements)
    by_ratio: dict[float, list[tuple[Block, Summary]]] = {}
    for block, summary in summaries:
        by_ratio.setdefault(block.ratio, []).append((block, summary))
    return [one for ratio in sorted(by_ratio) for one in _points(atlas, by_ratio[ratio])]


def _points(atlas: Atlas, blocks: Sequence[tuple[Block, Summary]]) -> Iterator[Point]:
    """Those of one ratio."""
    block = blocks[0][0]
    truth = atlas.panel.reference
    assert truth is not None
    rows = [row for _, summary in blocks for row in summary.rows.to_pylist()]
    outcomes = {(row["home"], row["seed"], row["cell"]): row for row in rows}
    seeds = tuple(sorted({row["seed"] for row in rows}))
    for home in block.panel.train:
        of = {member.name: share for member, share in home.shares.items()}
        yield Point(
            block.ratio,
            home,
            seeds,
            _rates(outcomes, home.name, seeds, of, "successes"),
            _rates(outcomes, home.name, seeds, {truth.name: 1.0}, "successes"),
            _rates(outcomes, home.name, seeds, {truth.name: 1.0}, "recovered"),
        )


def _rates(
    outcomes: dict[tuple[str, int, str], Any],
    home: str,
    seeds: Sequence[int],
    cells: dict[str, float],
    count: str,
) -> Rates:
    """Success rate by seed, over cells by their shares."""
    return np.array(
        [
            sum(
                share * outcomes[home, seed, cell][count] / outcomes[home, seed, cell]["episodes"]
                for cell, share in cells.items()
            )
            for seed in seeds
        ]
    )
