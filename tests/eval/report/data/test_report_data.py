"""What the report and the figures read out of a panel."""

from __future__ import annotations

import copy

import pytest
import report_example as example
from report_pages import page_of, panel_from, panel_of, raw_of
from report_rows import IMPOSSIBLE, SLOW, UNKNOWN

from integ_gym.eval.report.findings import findings_of
from integ_gym.eval.report.forests import (
    checks_of,
    declared_gaps,
    exploratory_gaps,
    trust_of,
)
from integ_gym.eval.report.ladders import ladders_of


def findings(panel):
    return findings_of(panel, trust_of(panel))


def test_says_what_is_false_in_plain_words() -> None:
    found = findings(panel_of("full"))
    assert found[0].kind == "agreement"
    classes = [entry.reference_class for entry in panel_of("full").matrix]
    passes, fails = classes.count("false_pass"), classes.count("false_fail")
    assert f"{passes} false passes and {fails} false fails do not." in found[0].lead
    artefact = next(finding for finding in found if finding.kind == "false_pass")
    assert artefact.lead.startswith("The policies trained on explicit_euler dt=0.05 reach 1.00")
    assert "belongs to the simulator, not to the physics" in artefact.lead
    assert any("would be thrown away" in finding.lead for finding in found)


def test_without_classes_it_says_so() -> None:
    panel = example.full_panel()
    for entry in panel["matrix"]:
        entry["reference_class"] = None
    assert [finding.kind for finding in findings(panel_from(panel))] == ["missing"]


def test_rows_that_did_not_learn_have_no_gap() -> None:
    panel = panel_of("nothing learned")
    assert declared_gaps(panel) == ()
    assert exploratory_gaps(panel) == ()
    text = " ".join(page_of("nothing learned").text.split())
    assert "1 not learned" in text
    assert "there is nothing to transfer" in text


def test_what_has_no_verdict_is_not_among_the_rest_either() -> None:
    panel = panel_of("every verdict")
    declared = {(judged.row, judged.cell) for judged in panel.verdicts}
    judged = {(gap.row, gap.cell): gap.verdict for gap in declared_gaps(panel)}
    assert set(judged.values()) == {"fails", "transfers", "inconclusive"}
    assert set(judged) < declared
    others = {(gap.row, gap.cell) for gap in exploratory_gaps(panel)}
    assert not others & declared
    assert not {cell for _, cell in others} & {IMPOSSIBLE, SLOW}
    assert UNKNOWN in {cell for _, cell in others}


def test_parts_add_up_to_the_loss() -> None:
    for name in ("full", "every verdict"):
        panel = panel_of(name)
        losses = [entry for entry in panel.matrix if entry.home_drop is not None]
        assert len(losses) > 30
        totals = [(entry.home_drop, entry) for entry in losses]
        totals += [(judged.total, judged) for judged in panel.verdicts]
        for total, own in totals:
            parts = (own.difficulty, own.deadline, own.overfitting)
            assert sum(part.estimate for part in parts) == pytest.approx(total.estimate)


def test_groups_are_integrators_from_coarse_to_fine_after_the_truth() -> None:
    groups = panel_of("full").groups
    assert [group.label for group in groups] == ["reference", *example.SCHEMES]
    assert [cell.dt for cell in groups[1].cells] == sorted(example.STEPS, reverse=True)
    assert groups[0].reference


def test_ladders_keep_the_two_control_periods_apart() -> None:
    panel = panel_of("full")
    ladder = ladders_of(panel)[0]

    def periods(rungs):
        return [panel.cell(rung.entry.cell).control_period for rung in rungs]

    for rungs in ladder.fixed.values():
        assert set(periods(rungs)) == {example.PERIOD}
    for rungs in ladder.following.values():
        assert periods(rungs) == [rung.dt for rung in rungs]
    assert set(ladder.following) == {
        "explicit_euler", "symplectic_euler", "rk4", "implicit_euler",
    }  # fmt: skip


def test_ladders_leave_out_engines_that_a_row_was_not_trained_on() -> None:
    panel = copy.deepcopy(raw_of("full"))
    for cell in panel["cells"]:
        if cell["integrator"] == "implicit_midpoint":
            cell["engine"] = "mujoco"
    read = panel_from(panel)
    assert "mujoco implicit_midpoint" in [group.label for group in read.groups]
    assert all("rk4" in ladder.fixed for ladder in ladders_of(read))
    assert not any("mujoco implicit_midpoint" in ladder.fixed for ladder in ladders_of(read))


def test_checks_compare_the_same_discretization() -> None:
    panel = panel_of("full")
    checks = checks_of(panel)
    assert list(checks) == ["mass +20 %", "latency 50 ms"]
    for found in checks.values():
        for check in found:
            assert check.before is not None
            assert check.before.row == check.after.row
            before, after = panel.cell(check.before.cell), panel.cell(check.after.cell)
            assert before.integrator == after.integrator
            assert before.dt == after.dt
