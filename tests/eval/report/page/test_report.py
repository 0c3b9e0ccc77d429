"""The report of a panel."""

from __future__ import annotations

import base64
import copy
import hashlib
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import report_example as example
from report_pages import Page, every_panel, page_of, panel_from, panel_of, raw_of

from integ_gym.eval.panel.conclusions import answer_lines
from integ_gym.eval.report import page as report_page
from integ_gym.eval.report.cards import LABEL_WORDS
from integ_gym.eval.report.figures import write_figures
from integ_gym.eval.report.page import render, write_report
from integ_gym.evidence.fields import LABELS
from integ_gym.support.terminal import fixed, together, true_minus

SECTIONS = [
    "matrix", "paired", "verdicts", "conclude", "gaps", "remedy", "ladder", "checks", "failures",
    "comparisons", "method", "reproduce",
]  # fmt: skip
AN_ENTRY = re.compile(r"r\d+c\d+(s\d+e\d+)?")


@every_panel
def test_writes_one_file_with_the_rendered_page(name: str, tmp_path: Path) -> None:
    path = write_report(panel_of(name), tmp_path / "new" / "panel")
    assert path == tmp_path / "new" / "panel" / "report.html"
    assert [entry.name for entry in path.parent.iterdir()] == ["report.html"]
    assert path.read_text("utf-8") == render(panel_of(name))


@every_panel
def test_ids_differ_and_every_inner_link_leads_somewhere(name: str) -> None:
    page = page_of(name)
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    inner = {link[1:] for link in page.values("href") if link.startswith("#")}
    places = {link for link in inner if not AN_ENTRY.fullmatch(link)}
    assert places <= set(ids)
    sections = [place for place in ids if place in SECTIONS]
    assert sections == [place for place in SECTIONS if place in sections]
    assert set(sections) == places
    always = {"matrix", "conclude", "method", "reproduce"}
    assert always | (set() if panel_of(name).given_alone else {"verdicts"}) <= places


@every_panel
def test_there_are_links_to_what_is_there_alone(name: str) -> None:
    panel, links = panel_of(name), page_of(name).values("href")
    assert ("#remedy" in links) == bool(panel.remedies)
    assert ("#comparisons" in links) == bool(panel.policy_comparisons)
    assert ("#checks" in links) == any(not cell.plain for cell in panel.cells)
    assert ("#engines" in links) == bool(panel.engine_agreement)
    assert {"./panel.json", "./figures/"} <= set(links)


@every_panel
def test_loads_nothing_and_links_only_beside_itself(name: str) -> None:
    page = page_of(name)
    assert page.values("src") == []
    for link in page.values("href"):
        assert link.startswith(("#", "./")) or link == "data:,"
    assert not {tag for tag, _ in page.tags} & {"iframe", "img", "object", "embed", "base"}
    html = render(panel_of(name))
    assert "url(" not in html
    assert "@import" not in html
    assert set(re.findall(r"https?://[^\"]*", html)) == {"http://www.w3.org/2000/svg"}


@every_panel
def test_only_its_own_script_can_run(name: str) -> None:
    page = page_of(name)
    assert len(page.scripts) == 1
    digest = base64.b64encode(hashlib.sha256(page.scripts[0].encode()).digest()).decode()
    policy = next(value for value in page.values("content") if "default-src" in value)
    assert f"script-src 'sha256-{digest}'" in policy
    assert "default-src 'none'" in policy
    assert not [a for _, attributes in page.tags for a in attributes if a.startswith("on")]


@every_panel
def test_every_entry_of_the_matrix_is_carried_and_every_grid_cell_has_its_place(name: str) -> None:
    panel, page = panel_of(name), page_of(name)
    head, _ = page.carried
    columns = {cell.name for cell in panel.columns}
    links = page.values("href")
    for entry in panel.matrix:
        anchor = panel.anchor(entry.row, entry.cell)
        told = head["entries"][anchor[1:].replace("c", "/")]
        assert ["episodes", f"{entry.episodes:,}"] in told["facts"]
        assert name == "hostile" or shlex.split(told["query"]) == shlex.split(entry.query)
        assert set(entry.file) <= set(head["files"])
        assert (f"#{anchor}" in links) or entry.cell not in columns
    shown = [t for t in page.values("title") if "evaluated on" in t and "success" in t]
    assert len(shown) == sum(e.cell in columns for e in panel.matrix)


@every_panel
def test_nothing_unknown_is_printed_as_code(name: str) -> None:
    page = page_of(name)
    words = page.text + " ".join(page.values("title") + page.values("aria-label"))
    words += json.dumps([entry["facts"] for entry in page.carried[0]["entries"].values()])
    assert not re.search(r"\b(None|nan|NaN|inf|Undefined)\b", words)
    assert ("{{" in words) == (name == "hostile")


def test_hostile_text_stays_text() -> None:
    page = page_of("hostile")
    assert example.HOSTILE in page.text
    assert f"Does a policy trained on one integrator survive another?{example.HOSTILE}" in page.text
    assert "49" not in page.text.split("Trained on × evaluated on")[0]
    files = page.carried[0]["files"].values()
    assert {"./javascript%3Aalert%281%29", "./evil.example/x"} <= set(files)
    assert all(link.startswith("./") for link in files)


def test_the_answer_comes_first_and_numbers_are_the_panels() -> None:
    panel, page = panel_of("full"), page_of("full")
    text = " ".join(page.text.split())
    places = [
        text.index(panel.question),
        text.index(panel.said(true_minus(answer_lines(panel)[0]))),
    ]
    assert places == sorted(places)
    assert places[1] < text.index("Verdicts on the declared family")
    for judged in panel.verdicts:
        assert panel.said(true_minus(judged.reason)) in text
    for entry in panel.matrix:
        assert fixed(entry.success.estimate) in text
    for failure in panel.failures:
        assert f"integ-gym evidence show runs/panel {failure.record_id}" in page.text
    assert panel.command in page.text
    assert "10 min 11 s" in text


def test_failures_are_counted_one_way() -> None:
    text = " ".join(page_of("full").text.split())
    panel = panel_of("full")
    baselines = {row.name for row in panel.rows if row.baseline}
    failed = [
        count
        for entry in panel.matrix
        if entry.row not in baselines
        for label, count in entry.labels.items()
        if label != "none"
    ]
    assert f"{sum(failed):,} episodes failed" in text


def test_every_verdict_has_its_card_with_the_parts_of_the_loss() -> None:
    panel, page = panel_of("every verdict"), page_of("every verdict")
    words = [
        "fails", "transfers", "inconclusive", "not learned", "unachievable", "too slow",
        "undecided",
    ]  # fmt: skip
    judged_in_turn = {judged.verdict.replace("_", " "): judged for judged in panel.verdicts}
    assert set(judged_in_turn) == set(words)
    text = " ".join(page.text.split())
    shown = text.split("Verdicts on the declared family")[1].split("Where a discretization")[0]
    tally = " ".join(f"1 {word}" for word in words)
    assert tally in shown
    cards = shown.split(tally)[1]
    for word in words:
        judged = judged_in_turn[word]
        head = f"{word} {panel.called(judged.row)} evaluated on {panel.called(judged.cell)}"
        assert head in cards
        card = cards.split(head)[1].split(" evaluated on ")[0]
        parts = " ".join(
            f"{name} {fixed(part.estimate, 2, True)}"
            for name, part in (
                ("difficulty", judged.difficulty),
                ("deadline", judged.deadline),
                ("overfitting", judged.overfitting),
                ("loss in all", judged.total),
            )
        )
        assert parts in card
        assert panel.said(true_minus(judged.reason)) in card
    few = " ".join(page_of("nothing learned").text.split())
    assert "0 fails 0 transfers 0 inconclusive 1 not learned" in few
    assert "0 too slow" not in few


def test_records_say_whether_their_cell_can_be_solved() -> None:
    panel, page = panel_of("every verdict"), page_of("every verdict")
    head, _ = page.carried
    for entry in panel.matrix:
        cell = panel.cell(entry.cell)
        place = panel.anchor(entry.row, entry.cell)[1:].replace("c", "/")
        status = f"{cell.achievability.replace('_', ' ')}: {cell.achievability_reason}"
        assert ["the cell", together(panel.said(status))] in head["entries"][place]["facts"]


def test_every_failure_label_has_its_words() -> None:
    assert ["none", *LABEL_WORDS] == list(LABELS)
    text = " ".join(page_of("full").text.split())
    for label in ("unachievable", "not_learned", "too_slow"):
        assert f"{label.replace('_', ' ')} {LABEL_WORDS[label]}" in text


def test_a_given_policy_is_told_of_in_words_of_its_own() -> None:
    page = page_of("given")
    text = " ".join(page.text.split())
    assert "verdicts" not in page.values("id")
    assert "#verdicts" not in page.values("href")
    assert "declares no family" not in text
    assert "over seeds" not in text
    assert "over training seeds" not in text
    assert "Another seed of the same training could do otherwise." in text
    assert "The policy file names no training discretization." in text


def test_a_given_policy_that_never_succeeds_is_told_of_once() -> None:
    raw = copy.deepcopy(raw_of("given"))
    for entry in raw["matrix"]:
        entry["success"]["estimate"] = 0.0
    panel = panel_from(raw)
    told = "\n".join(answer_lines(panel))
    assert told.startswith("Mean return")
    assert "Its success" not in told


def test_a_legend_speaks_of_homes_where_there_are_any() -> None:
    assert "trained here" not in page_of("given").text
    assert "trained here" in page_of("full").text


def test_a_task_of_gymnasium_is_told_in_words() -> None:
    raw = copy.deepcopy(raw_of("full"))
    raw["spec"]["env_id"], raw["spec"]["environment"] = "InvertedPendulum-v5", {}
    text = " ".join(Page(render(panel_from(raw))).text.split())
    assert "The task. InvertedPendulum-v5 of Gymnasium." in text
    assert "not terminated within the time limit" in text


def test_the_page_says_what_was_applied() -> None:
    raw = copy.deepcopy(raw_of("full"))
    first = raw["cells"][0]
    first["applied"] = {
        "engine": "playground", "engine_version": "0.2.0", "integrator": "Euler", "dt": 0.007,
        "substeps": 3, "control_period": 0.021,
    }  # fmt: skip
    text = " ".join(re.sub(r"<[^>]+>", " ", render(panel_from(raw))).split())
    assert "never from what was asked" in text
    assert "playground 0.2.0 Euler 0.007 3 0.021 1" in text
    others = {json.dumps(cell["applied"], sort_keys=True) for cell in raw["cells"][1:]}
    assert text.count("native 0.1.0") == len(others)
    for place in raw["cells"]:
        place["applied"] = None
    assert "never from what was asked" not in Page(render(panel_from(raw))).text


def test_engines_have_a_section_where_a_panel_has_them() -> None:
    line = {
        "cell": "drake radau1 dt=0.05", "engine": "drake", "integrator": "radau1", "dt": 0.05,
        "control_period": 0.05, "map": "implicit_euler",
        "twin": "implicit_euler dt=0.05", "success": 0.25, "twin_success": 0.5, "differing": 7,
        "episodes": 28, "largest": 0.75,
    }  # fmt: skip
    lost = {"twin": None, "twin_success": None, "differing": None, "largest": None}
    alone = {**line, "integrator": "runge_kutta5", **lost}
    page = render(panel_from({**raw_of("full"), "engine_agreement": [line, alone]}))
    for text in ('id="engines"', "drake radau1", "7 of 28", "0.75"):
        assert text in page
    assert 'id="engines"' not in render(panel_of("full"))


def test_an_almost_empty_panel_still_reads(tmp_path: Path) -> None:
    lists = ("rows", "cells", "matrix", "verdicts", "policy_comparisons", "failures", "remedies")
    raw = {**raw_of("full"), **{name: [] for name in lists}, "training_costs": {}}
    panel = panel_from(raw)
    Page(render(panel))
    assert write_figures(panel, tmp_path) == []


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_report(panel_of("given"), tmp_path)
    before = path.read_bytes()

    def broken(source: Path, target: Path) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("os.replace", broken)
    with pytest.raises(OSError, match="disk full"):
        write_report(panel_of("full"), tmp_path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("module", ["jinja2", "matplotlib"])
def test_a_missing_extra_names_its_remedy(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    report_page._template.cache_clear()
    write: Any = write_report if module == "jinja2" else write_figures
    with pytest.raises(ModuleNotFoundError) as caught:
        write(panel_of("given"), tmp_path)
    assert str(caught.value) == (f'{module} is not installed; run: pip install -e ".[report]"')


def test_neither_needs_more_than_its_own_package(tmp_path: Path) -> None:
    (tmp_path / "panel.json").write_text(json.dumps(raw_of("given")), encoding="utf-8")
    code = (
        "import sys; import integ_gym.eval.report.page, integ_gym.eval.report.figures; "
        "assert not {'matplotlib', 'jinja2'} & set(sys.modules); "
        "from pathlib import Path; from integ_gym.eval.panel.result import read_panel; "
        "import integ_gym.eval.report.figures as f; "
        "f.write_figures(read_panel(Path('panel.json')), '.'); "
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60, cwd=tmp_path)
