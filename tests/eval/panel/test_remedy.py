"""Mixtures held against single discretizations, and what training cost, on known numbers."""

import math

import numpy as np
import pytest
from known_outcomes import matrix_of
from scipy import stats

from integ_gym.envs.settings import Discretization
from integ_gym.eval.panel.cells import Cell, DiscretizationMixture
from integ_gym.eval.panel.findings import RATE, WINDOW, decisions_to_success, remedies
from integ_gym.eval.panel.matrix import PanelLayout
from integ_gym.eval.panel.result import Policy, Row
from integ_gym.eval.statistics import median_interval, paired_difference, unpaired_difference

SEEDS, EPISODES = 6, 4
A, B, C = (Discretization(name, 0.05, 0.05) for name in ("explicit_euler", "rk4", "implicit_euler"))
D = Discretization("symplectic_euler", 0.05, 0.05)
TRUTH = Discretization("reference", 0.05, 0.05)
MIXED = DiscretizationMixture("both", ((A, 3.0), (B, 1.0)))
SUCCESS = {
    ("explicit_euler dt=0.05", A): 1.0, ("explicit_euler dt=0.05", B): 0.25,
    ("explicit_euler dt=0.05", C): 0.0, ("explicit_euler dt=0.05", D): 0.0,
    ("explicit_euler dt=0.05", TRUTH): 0.25,
    ("rk4 dt=0.05", A): 0.5, ("rk4 dt=0.05", B): 1.0, ("rk4 dt=0.05", C): 0.0,
    ("rk4 dt=0.05", D): 1.0, ("rk4 dt=0.05", TRUTH): 1.0,
    ("implicit_euler dt=0.05", A): 0.0, ("implicit_euler dt=0.05", B): 0.0,
    ("implicit_euler dt=0.05", C): 0.0, ("implicit_euler dt=0.05", D): 0.0,
    ("implicit_euler dt=0.05", TRUTH): 0.0,
    ("both", A): 1.0, ("both", B): 0.5, ("both", C): 0.0, ("both", D): 0.5, ("both", TRUTH): 1.0,
    ("handmade", A): 1.0, ("handmade", B): 1.0, ("handmade", C): 0.0, ("handmade", D): 1.0,
    ("handmade", TRUTH): 1.0,
}  # fmt: skip


def _panel(success=SUCCESS):
    """Layout and matrix in which every seed has the same success rate."""
    homes = {home.name: home for home in (A, B, C, MIXED)}
    rows = tuple(
        Row.of(
            name,
            "trained" if name in homes else "baseline",
            [Policy(id=f"{name}-{seed}") for seed in range(SEEDS)],
            homes.get(name),
        )
        for name in (*homes, "handmade")
    )
    cells = {d.name: Cell.of(d, "reference" if d == TRUTH else "grid") for d in (A, B, C, D, TRUTH)}
    layout = PanelLayout(rows, cells, {row.name: tuple(cells) for row in rows}, TRUTH.name)

    def outcome(row, cell, _, k):
        return {"success": k < success[row.name, cells[cell].discretization] * EPISODES}

    return layout, matrix_of(layout, EPISODES, outcome)


def _remedies(layout, matrix):
    return remedies(layout, matrix, layout.losses(matrix))


def test_home_of_a_mixture_is_the_mean_over_its_members_by_their_shares():
    layout, matrix = _panel()
    np.testing.assert_allclose(matrix.home_rates("both"), 0.75 * 1.0 + 0.25 * 0.5)
    np.testing.assert_allclose(matrix.home_rates("rk4 dt=0.05"), 1.0)
    assert matrix.home_rates("handmade") is None
    assert matrix.learned("both") is True
    assert matrix.learned("implicit_euler dt=0.05") is False
    assert matrix.learned("handmade") is None
    assert (matrix.rows["both"].home, matrix.rows["rk4 dt=0.05"].home) == (None, "rk4 dt=0.05")
    home = [0.875] * SEEDS
    drop = layout.loss(matrix, "both", D.name).total
    assert drop.estimate == paired_difference(home, [0.5] * SEEDS).interval.estimate
    assert layout.loss(matrix, "both", A.name).total.estimate == -0.125
    assert layout.loss(matrix, "rk4 dt=0.05", B.name) is None
    assert layout.native(A.name) == A.name
    gap = matrix._transfer_gap("both", B.name, layout.native(B.name))
    assert gap.estimate == unpaired_difference([1.0] * SEEDS, [0.5] * SEEDS).interval.estimate


def test_a_remedy_counts_where_others_lose_and_it_does_not():
    layout, matrix = _panel()
    (found,) = _remedies(layout, matrix)
    assert found.row == "both"
    assert found.singles == (A.name, B.name)
    cells = {cell.cell: cell for cell in found.cells}
    assert [one.row for one in cells[A.name].lost] == [B.name]
    assert [one.row for one in cells[TRUTH.name].lost] == [A.name]
    assert [one.row for one in cells[C.name].lost] == []
    assert [name for name, cell in cells.items() if cell.member] == [A.name, B.name]
    assert [name for name, cell in cells.items() if not cell.solved] == [C.name]
    assert cells[B.name].overfitting.estimate == 0.875 - 0.5
    assert cells[C.name].overfitting.estimate == 0.0
    assert layout.loss(matrix, A.name, C.name).difficulty.estimate == 1.0
    (lost,) = cells[A.name].lost
    assert lost.overfitting.estimate == 0.5
    assert lost.difference.estimate == 0.5
    assert lost.difference.low < 0.5 < lost.difference.high <= 1.0


def test_where_nobody_shows_that_a_cell_can_be_solved_it_is_lost_but_not_harmful():
    unsolved = {key: 0.0 if key[1] == D else rate for key, rate in SUCCESS.items()}
    (found,) = _remedies(*_panel(unsolved))
    cells = {cell.cell: cell for cell in found.cells}
    assert [one.row for one in cells[D.name].lost] == [A.name, B.name]
    assert [name for name, cell in cells.items() if not cell.solved] == [C.name, D.name]


def test_what_a_second_horizon_wins_back_is_not_lost():
    layout, matrix = _panel()
    for records in matrix.records(A.name, TRUTH.name):
        records[-1]["replay_second_horizon"] = records[-2]["replay_second_horizon"] = True
        records[-3]["replay_second_horizon"] = True
    loss = layout.loss(matrix, A.name, TRUTH.name)
    parts = (loss.total, loss.difficulty, loss.deadline, loss.overfitting)
    assert [part.estimate for part in parts] == [0.75, 0.0, 0.75, 0.0]
    (found,) = _remedies(layout, matrix)
    assert not next(cell for cell in found.cells if cell.cell == TRUTH.name).lost


def test_where_nobody_loses_there_is_nothing_to_remedy():
    perfect = {key: float(key[0] != C.name) for key in SUCCESS}
    (found,) = _remedies(*_panel(perfect))
    assert all(not cell.lost for cell in found.cells)


def test_a_panel_without_mixtures_has_no_remedy():
    layout, matrix = _panel()
    rows = tuple(row for row in layout.rows if row.name != "both")
    single = PanelLayout(rows, layout.cells, layout.cells_of, layout.reference)
    assert _remedies(single, matrix) == ()


def test_decisions_until_most_training_episodes_succeed():
    lengths = np.arange(1, 301)
    late = np.arange(300) >= 120
    reached = 120 + round(RATE * WINDOW)
    assert decisions_to_success(lengths, late) == lengths[:reached].sum()
    assert decisions_to_success(lengths, np.ones(300, bool)) == lengths[:WINDOW].sum()
    assert decisions_to_success(lengths, np.zeros(300, bool)) == math.inf
    short = WINDOW - 1
    assert decisions_to_success(lengths[:short], np.ones(short, bool)) == math.inf
    every_tenth_fails = np.arange(300) % 10 > 0
    assert decisions_to_success(lengths, every_tenth_fails) == lengths[:WINDOW].sum()


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (list(range(1, 11)), (5.5, 2.0, 9.0, 0.978515625)),
        ([3.0, 1.0, 2.0, math.inf, 5.0], (3.0, 1.0, None, 0.9375)),
        ([1.0, math.inf, math.inf], (None, 1.0, None, 0.75)),
        ([1.0, 3.0], (2.0, 1.0, 3.0, 0.5)),
        ([math.inf] * 6, (None, None, None, 0.96875)),
    ],
)
def test_median_between_order_statistics(values, expected):
    found = median_interval(values)
    assert (found.estimate, found.low, found.high, found.level) == expected


@pytest.mark.parametrize("seeds", [6, 9, 20])
def test_median_interval_has_the_level_of_its_order_statistics(seeds):
    """Exact for a continuous distribution: each is below the median or above it."""
    found = median_interval(list(range(seeds)))
    assert found.level == pytest.approx(1.0 - 2.0 * stats.binom.cdf(found.low, seeds, 0.5))
    assert found.level >= 0.95 > 1.0 - 2.0 * stats.binom.cdf(found.low + 1, seeds, 0.5)
    assert found.high == seeds - 1 - found.low


def test_median_needs_two_seeds_and_numbers():
    assert median_interval([1.0]) is None
    with pytest.raises(ValueError, match="without NaN"):
        median_interval([1.0, math.nan])
    with pytest.raises(ValueError, match="shape"):
        median_interval([[1.0, 2.0]])
