"""The answer's first line says home, truth, loss and cause; the rest and what to do follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from integ_gym.envs.settings import Discretization
from integ_gym.eval.panel.achieve import Tried
from integ_gym.eval.panel.artefact import build_artefact
from integ_gym.eval.panel.cells import Cell, Perturbation
from integ_gym.eval.panel.conclusions import (
    Finding,
    answer_lines,
    finding_of,
    next_step,
)
from integ_gym.eval.panel.matrix import Matrix, PanelLayout
from integ_gym.eval.panel.result import Cost, Look, Panel, Policy, Row
from integ_gym.eval.report.forests import paired_success
from integ_gym.eval.report.page import _headline
from integ_gym.eval.verdict import Search

HOME = Discretization("symplectic_euler", 0.05, 0.05)
FINER = Discretization("symplectic_euler", 0.025, 0.05)
RK4 = Discretization("rk4", 0.05, 0.05)
TRUTH = Discretization("reference", 0.05, 0.05)
HEAVY = "mass +20 %"
SOLVED = Tried((1.0,), (1.0,))
UNREACHED = Tried((0.0,), (0.0,), Search(20.0, 10.0, (1.0,), "planted"))


def judged(
    success: Mapping[str, float],
    returns: Mapping[str, float] | None = None,
    *,
    home: Discretization | None = HOME,
    truth: bool = True,
    starts: int = 50,
    command: str = "integ-gym evaluate mine.zip --env IntegPendulum-v0 --out runs/mine",
    tried: Tried = SOLVED,
) -> Panel:
    """An evaluation of one policy; what is not given is as at home.

    ``tried`` is what others reach on the truth.
    """
    discretizations = [HOME, FINER, RK4, *([TRUTH] if truth else [])]
    cells = {d.name: Cell.of(d, "reference" if d == TRUTH else "grid") for d in discretizations}
    heavy = Cell.of(HOME, "perturbation", Perturbation(HEAVY, {"mass": 1.2}))
    cells[heavy.name] = heavy
    rows = (
        Row.of("mine", "given", [Policy(id="mine")], home),
        Row.of("random", "baseline", [Policy(id="random")]),
    )
    noise = np.linspace(-1.0, 1.0, starts)
    earned = {**dict.fromkeys(cells, -10.0), **(returns or {})}
    rates = {**dict.fromkeys(cells, success[HOME.name]), **success}
    records = [
        {
            "policy_id": row.name, "cell": cell, "episode_index": k,
            "record_id": f"{row.name}{cell}{k}",
            "success": row.name == "mine" and k < round(rates[cell] * starts),
            "replay_second_horizon": None,
            "return": (earned[cell] if row.name == "mine" else -110.0) + noise[k],
            "time_to_success": None, "energy_residual_total": 0.0,
            "energy_residual_abs_total": 0.0, "solver_status": "ok", "failure_label": "none",
            "failure_reason": "", "arrival_energy": 10.0, "arrival_residual": 1.0,
        }
        for row in rows
        for cell in cells
        for k in range(starts)
    ]  # fmt: skip
    layout = PanelLayout(
        rows, cells, {row.name: tuple(cells) for row in rows}, TRUTH.name if truth else None,
        tried={TRUTH.name: tried},
    )  # fmt: skip
    return build_artefact(
        layout, Matrix(rows, records, starts),
        {"mine": (), "random": ()},
        directory="runs/mine", name="evaluate mine", question="?", command=command, versions={},
        spec={"env_id": "IntegPendulum-v0", "environment": {"max_torque": 0.7}},
        cost=Cost(wall_seconds=0.0, workers=1, train_seconds=0.0, evaluate_seconds=0.0),
    )  # fmt: skip


def found(panel: Panel) -> Finding:
    finding = finding_of(panel)
    assert finding is not None
    return finding


def test_a_clean_result_leads_with_that() -> None:
    """Nothing is lost on the truth: what is lost on other cells and perturbations comes later."""
    panel = judged({HOME.name: 1.0, RK4.name: 0.2, f"{HOME.name}, {HEAVY}": 0.1})
    first, *rest = panel.answer.splitlines()
    assert first == (
        "Success at home 1.00, on the truth 1.00, lost 0.00 (95 % interval −0.03 to 0.03): "
        "practically equal (within ±0.1), dt is not the cause."
    )
    assert found(panel).status == "not_cause"
    others, perturbed = (next(x for x in rest if noun in x) for noun in ("discretiz", "perturb"))
    assert others.startswith("2 other discretizations against home: 1 lower, 1 practically equal")
    assert f"Largest: {RK4.name} lost 0.80 (0.66 to 0.89)." in others
    assert HEAVY not in others
    assert perturbed.startswith("1 perturbation against home: 1 lower. Largest:")
    assert f"{HEAVY} lost 0.90" in perturbed


def test_a_loss_on_the_truth_is_put_down_to_dt() -> None:
    panel = judged({HOME.name: 1.0, TRUTH.name: 0.4}, {TRUTH.name: -60.0})
    assert panel.headline == (
        "Success at home 1.00, on the truth 0.40, lost 0.60 (95 % interval 0.45 to 0.72): dt is "
        "the cause."
    )
    assert any(
        line.startswith("Mean return at home −10.00, on the truth −60.00, lost 50.00")
        and "50 % of its lead over random" in line
        for line in answer_lines(panel)
    )


@pytest.mark.parametrize(
    ("tried", "end"),
    [
        (UNREACHED, "the truth cannot be solved in time, so the loss says nothing about dt."),
        (Tried((0.0,), (1.0,)),
         "the truth cannot be solved in time, so the loss says nothing about dt."),
        (Tried(), "whether the truth can be solved in time is not known, so the loss says nothing "
         "about dt."),
    ],
)  # fmt: skip
def test_a_loss_on_a_truth_that_nobody_solves_says_nothing_about_dt(tried: Tried, end: str) -> None:
    panel = judged({HOME.name: 1.0, TRUTH.name: 0.1}, tried=tried)
    assert found(panel).status == "closed"
    assert panel.headline.startswith("Success at home 1.00, on the truth 0.10, lost 0.90 (95 %")
    assert _headline(panel)[1] == end
    assert "No conclusion is drawn from some cells" in panel.answer.splitlines()[-1]
    assert next_step(panel) is None


def test_a_loss_of_return_needs_no_success_on_the_truth() -> None:
    """But none is put down to dt where a search rules the goal out."""
    lost = {TRUTH.name: -60.0}
    assert found(judged({HOME.name: 0.0}, lost, tried=Tried())).status == "cause"
    assert found(judged({HOME.name: 0.0}, lost, tried=UNREACHED)).status == "closed"


def test_a_small_loss_that_is_shown_is_practically_equal() -> None:
    panel = judged({HOME.name: 1.0, TRUTH.name: 0.98}, starts=400)
    assert found(panel).status == "not_cause"


def test_few_starts_show_nothing_either_way() -> None:
    panel = judged({HOME.name: 1.0, TRUTH.name: 0.67}, starts=3)
    assert panel.headline.endswith("3 starts do not show whether dt is the cause.")
    step = next_step(panel)
    assert step is not None
    assert step.command == (
        "integ-gym evaluate mine.zip --env IntegPendulum-v0 --out runs/mine --episodes 12"
    ), "in the same directory, which counts its looks"
    told = f"{panel.command} --episodes 3 --no-progress"
    step = next_step(judged({HOME.name: 1.0, TRUTH.name: 0.67}, starts=3, command=told))
    assert step is not None
    assert step.command == f"{panel.command} --no-progress --episodes 12"


def test_what_is_gained_on_the_truth_is_no_loss() -> None:
    panel = judged({HOME.name: 0.4, TRUTH.name: 0.9})
    assert "gained 0.50 (95 % interval 0.35 to 0.63)" in panel.headline
    assert panel.headline.endswith("nothing is lost, and dt makes it look worse at home.")


def test_an_unknown_home_is_said_first_and_asked_for() -> None:
    panel = judged({HOME.name: 1.0, TRUTH.name: 0.4}, home=None)
    first, second, *_ = panel.answer.splitlines()
    assert first.startswith("Success on the truth 0.40 (0.27 to 0.54); home unknown, so what is")
    assert first.endswith("lost is unknown, and so is whether dt is the cause.")
    assert second.startswith("Success is from 0.40 (the truth) to 1.00 (")
    step = next_step(panel)
    assert step is not None
    assert step.command.endswith("runs/mine-home --home integrator=…,dt=…,control_period=…")
    assert step.purpose == "Say what it was trained on"
    look = Look(seeds=1, episodes=50, natives=0, level_exceeds=0.0, level_equivalent=0.0)
    step = next_step(msgspec.structs.replace(panel, looks=(look, look)))
    assert step is not None
    assert step.purpose.endswith("; this was look 2, and all of them count there too")


def test_a_home_that_is_the_truth_needs_no_comparison() -> None:
    panel = judged({HOME.name: 1.0}, home=TRUTH)
    assert panel.headline == "Success at home 1.00, and home is the truth: dt is not the cause."


def test_without_a_truth_the_finest_step_stands_in_by_its_own_name() -> None:
    panel = judged({HOME.name: 1.0}, {FINER.name: -40.0}, truth=False)
    assert panel.headline.startswith(
        f"Mean return at home −10.00, at the finest step ({FINER.name}) −40.00, lost 30.00 (95 %"
    )
    assert panel.headline.endswith("30 % of its lead over random): dt is the cause.")
    assert "This task has no truth" in panel.answer
    same = judged({HOME.name: 1.0}, {FINER.name: -10.5}, truth=False)
    assert same.headline.endswith(
        "practically equal (within 10 % of its lead over random), dt is not the cause."
    )


def test_a_home_at_the_finest_step_asks_for_a_finer_one() -> None:
    panel = judged({HOME.name: 1.0}, truth=False, home=FINER)
    assert "home is the finest step here" in panel.headline
    step = next_step(panel)
    assert step is not None
    assert step.command.endswith("--out runs/mine --dt 0.05 --dt 0.025 --dt 0.0125")


def test_a_policy_that_never_succeeds_is_compared_by_its_return() -> None:
    panel = judged({HOME.name: 0.0}, {TRUTH.name: -60.0})
    assert panel.headline.startswith("Mean return at home −10.00, on the truth −60.00, lost 50.00")
    assert "It never succeeds, so returns are compared." in panel.answer


@pytest.mark.parametrize(("there", "step"), [(0.4, "0.025"), (1.0, "0.05")])
def test_the_next_command_checks_the_step(there: float, step: str) -> None:
    """Half of it where success is lost; the same with other seeds where none is."""
    following = next_step(judged({HOME.name: 1.0, TRUTH.name: there}))
    assert following is not None
    assert following.command == (
        "integ-gym check --env IntegPendulum-v0 --integrator symplectic_euler "
        f"--dt {step} --control-period 0.05 --env-arg max_torque=0.7"
    )


def test_from_python_the_next_call_is_named() -> None:
    panel = judged({HOME.name: 1.0, TRUTH.name: 0.67}, starts=3, command="integ_gym.evaluate")
    step = next_step(panel)
    assert step is not None
    assert step.command == "integ_gym.evaluate(…, episodes=12)"


def test_the_file_and_the_page_say_the_same() -> None:
    panel = judged({HOME.name: 1.0, TRUTH.name: 0.4})
    assert tuple(panel.answer.splitlines()) == answer_lines(panel)
    assert panel.headline in repr(panel)
    assert replace(found(panel)).cell == TRUTH.name


def test_the_page_has_perturbations_apart_and_marks_what_is_practically_equal() -> None:
    panel = judged({HOME.name: 1.0, RK4.name: 0.2, f"{HOME.name}, {HEAVY}": 0.1})
    forest = paired_success(panel)
    assert forest is not None
    cells, perturbed = forest.blocks
    assert cells.title.endswith("discretizations against what it does at home")
    assert perturbed.title.endswith("perturbations against what it does at home")
    assert [line.cell for line in perturbed.lines] == [f"{HOME.name}, {HEAVY}"]
    tones = {line.cell: line.marks[0].tone for line in cells.lines}
    assert tones == {FINER.name: "transfers", RK4.name: "accent", "truth": "transfers"}
    assert "green: practically equal (within ±0.1)" in forest.about
