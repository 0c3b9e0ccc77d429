"""Panels whose answer is planted: what happened is known, and must be what is said."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from known_outcomes import matrix_of, panel_of

from integ_gym.envs.settings import Discretization
from integ_gym.eval.contract import BoundaryCheck, Contract
from integ_gym.eval.panel.achieve import Tried
from integ_gym.eval.panel.cells import Cell
from integ_gym.eval.panel.contracts import Contracts, Pair
from integ_gym.eval.panel.matrix import PanelLayout
from integ_gym.eval.panel.result import Panel, Policy, Row
from integ_gym.eval.verdict import Search

Rates = npt.NDArray[np.float64]
SEEDS, EPISODES = 54, 10
HERE = Discretization("explicit_euler", 0.05, 0.05)
THERE = Discretization("symplectic_euler", 0.05, 0.05)
TRUTH = Discretization("reference", 0.05, 0.05)
ROWS = (HERE, THERE, TRUTH)
FAMILY = ((HERE.name, THERE.name), (HERE.name, TRUTH.name), (THERE.name, TRUTH.name))
PERFECT = np.ones(SEEDS)
SOLVED = Tried((1.0,) * 100, (1.0,) * 100)
LOST = Tried((0.0,) * 100, (0.0,) * 100, Search(20.0, 10.0, (4.85,) * 20, "searched"))
SLOW = Tried((0.0,) * 100, (1.0,) * 100)


def planted(
    success: Callable[[str, str], Rates],
    recovered: Callable[[str, str], Rates] | None = None,
    tried: dict[str, Tried] | None = None,
    family: tuple[tuple[str, str], ...] = FAMILY,
    contracts: Contracts | None = None,
) -> Panel:
    """A panel of three rows and cells with the rates of every seed, by (row, cell)."""
    rows = tuple(
        Row.of(
            home.name,
            "trained",
            [Policy(id=f"{home.name}-{seed}") for seed in range(SEEDS)],
            home,
        )
        for home in ROWS
    )
    cells = {d.name: Cell.of(d, "reference" if d == TRUTH else "grid") for d in ROWS}
    later = recovered or success

    def outcome(row, cell, seed, k):
        within, again = (
            round(rates(row.name, cell)[seed] * EPISODES) for rates in (success, later)
        )
        return {"success": k < within, "replay_second_horizon": k < again}

    can = dict.fromkeys(cells, SOLVED) | (tried or {})
    layout = PanelLayout(
        rows, cells, {row.name: tuple(cells) for row in rows}, TRUTH.name, family, tried=can,
        contracts=contracts or {},
    )  # fmt: skip
    matrix = matrix_of(layout, EPISODES, outcome)
    return panel_of(layout, matrix, spec={"control_period": 0.05})


def verdicts(panel: Panel) -> dict[tuple[str, str], str]:
    return {(judged.row, judged.cell): judged.verdict for judged in panel.verdicts}


def test_all_transfer() -> None:
    panel = planted(lambda row, cell: PERFECT)
    assert set(verdicts(panel).values()) == {"transfers"}
    assert panel.headline.startswith("Success at home 1.00, on the truth 1.00, lost 0.00 (95 %")
    assert panel.headline.endswith("practically equal (within ±0.1), dt is not the cause.")


def test_what_holds_and_comes_late_is_told() -> None:
    late = FAMILY[1]
    panel = planted(
        lambda row, cell: PERFECT * (0.6 if (row, cell) == late else 1.0),
        lambda row, cell: PERFECT,
    )
    assert set(verdicts(panel).values()) == {"transfers"}
    assert panel.headline.startswith("Success at home 1.00, on the truth 0.60, lost 0.40")
    assert panel.headline.endswith(
        f"trained on {HERE.name}: the time limit is the cause, overfitting to dt is not."
    )
    assert "0.40 comes back in twice the time" in panel.answer
    assert "3 hold (" in panel.answer


def test_where_the_contract_of_home_is_not_kept_nothing_is_said_to_be_lost() -> None:
    differs = BoundaryCheck(boundary="force", sizes=(1, 2), tolerance=1e-6)
    contract = Contract(
        first=HERE.name, second=THERE.name, states=1, starts_alone=False, checks=(differs,)
    )
    panel = planted(lambda row, cell: PERFECT, contracts={Pair(HERE, THERE): contract})
    entry, back = panel.entry(HERE.name, THERE.name), panel.entry(THERE.name, HERE.name)
    assert entry.home_drop is entry.overfitting is entry.transfer_gap is entry.reference_class
    assert entry.transfer_gap is None is not back.transfer_gap


def test_overfitting_fails() -> None:
    lost = FAMILY[0]
    panel = planted(lambda row, cell: PERFECT * (0.2 if (row, cell) == lost else 1.0))
    found = verdicts(panel)
    assert found.pop(lost) == "fails"
    assert set(found.values()) == {"transfers"}
    (judged,) = (one for one in panel.verdicts if one.verdict == "fails")
    assert judged.overfitting.estimate == pytest.approx(0.8)
    assert judged.total.estimate == pytest.approx(0.8)
    assert panel.headline.startswith(
        f"Success at home 1.00, on {THERE.name} 0.20, lost 0.80 (95 % interval"
    )
    assert panel.headline.endswith(f"trained on {HERE.name}: dt is the cause.")
    assert f"Of 3 declared transfers, 1 fails ({HERE.name} on {THERE.name}), 2 hold" in panel.answer


def test_a_cell_that_nobody_can_solve_is_no_failure_of_the_policies() -> None:
    panel = planted(
        lambda row, cell: PERFECT * (0.0 if cell == THERE.name else 1.0), tried={THERE.name: LOST}
    )
    assert verdicts(panel)[FAMILY[0]] == "unachievable"
    assert panel.cell(THERE.name).achievability == "unachievable"
    assert verdicts(panel)[FAMILY[2]] == "not_learned"
    assert verdicts(panel)[FAMILY[1]] == "transfers"
    assert f"no control that was found solves {THERE.name}" in panel.answer
    assert "dt is not the cause" in panel.headline


def test_a_cell_that_takes_two_horizons_is_too_slow() -> None:
    def success(row: str, cell: str) -> Rates:
        return PERFECT * (0.0 if cell == THERE.name else 1.0)

    panel = planted(success, lambda row, cell: PERFECT, tried={THERE.name: SLOW})
    assert verdicts(panel)[FAMILY[0]] == "too_slow"
    assert f"only twice the time solves {THERE.name}" in panel.answer


def test_a_deadline_is_no_overfitting() -> None:
    def success(row: str, cell: str) -> Rates:
        return PERFECT * (0.1 if (row, cell) == FAMILY[0] else 1.0)

    panel = planted(success, lambda row, cell: PERFECT)
    (judged,) = (one for one in panel.verdicts if (one.row, one.cell) == FAMILY[0])
    assert judged.verdict == "transfers"
    assert (judged.total.estimate, judged.deadline.estimate) == (0.9, 0.9)


def test_without_a_family_the_largest_loss_that_says_something_is_told() -> None:
    """The first row loses all where nobody succeeds; the second loses 0.7 by overfitting."""
    success = {(HERE.name, TRUTH.name): 0.9, (TRUTH.name, HERE.name): 0.3}

    def at(row: str, cell: str) -> Rates:
        return PERFECT * (0.0 if cell == THERE.name else success.get((row, cell), 1.0))

    panel = planted(at, tried={THERE.name: LOST}, family=())
    told = [(entry.row, entry.cell) for entry in panel.exploratory]
    assert told == [(TRUTH.name, HERE.name), (HERE.name, TRUTH.name)]
    assert panel.headline.startswith(f"Success at home 1.00, on {HERE.name} 0.30, lost 0.70")
    assert panel.headline.endswith(
        "trained on the truth: dt looks like the cause (exploratory: no family was declared)."
    )
    assert "1 loses more than 0.2 of success by overfitting and 1 at most 0.1" in panel.answer
    assert f"no control that was found solves {THERE.name}" in panel.answer


def test_nobody_learned() -> None:
    panel = planted(lambda row, cell: 0.3 * PERFECT)
    assert set(verdicts(panel).values()) == {"not_learned"}
    assert panel.answer.startswith("Not answered: no policies of the declared transfers")


def test_one_lucky_seed_decides_nothing() -> None:
    lucky = np.zeros(SEEDS)
    lucky[0] = 1.0
    panel = planted(lambda row, cell: lucky if (row, cell) == FAMILY[0] else PERFECT)
    assert verdicts(panel)[FAMILY[0]] == "fails"
    panel = planted(lambda row, cell: lucky)
    assert set(verdicts(panel).values()) == {"not_learned"}


@pytest.mark.parametrize(("lost", "verdict"), [(1, "transfers"), (2, "inconclusive")])
def test_lost_seeds_count_as_far_as_a_tenth_is_not_ruled_out(lost: int, verdict: str) -> None:
    """Of 54 seeds one may be lost (P = 0.024 where a tenth are), two may not (0.083).

    A first look spends three quarters of the level: P must be below 0.0375.
    """
    unlucky = PERFECT.copy()
    unlucky[:lost] = 0.0
    panel = planted(lambda row, cell: unlucky if (row, cell) == FAMILY[0] else PERFECT)
    assert verdicts(panel)[FAMILY[0]] == verdict
    assert verdicts(panel)[FAMILY[1]] == "transfers"


def test_one_lucky_start_decides_nothing() -> None:
    once = np.full(SEEDS, 1.0 / EPISODES)
    panel = planted(lambda row, cell: once if (row, cell) == FAMILY[0] else PERFECT)
    assert verdicts(panel)[FAMILY[0]] == "fails"
