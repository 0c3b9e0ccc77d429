"""The report of a panel: one safe, light, whole file with the panel's numbers."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import report_example as example
from driving import Browser
from report_pages import (
    MOST_BYTES,
    MOST_NODES,
    Page,
    episodes_of,
    every_panel,
    page_of,
    panel_from,
    panel_of,
    raw_of,
    render,
)

from integ_gym.eval.panel.result import Panel
from integ_gym.eval.report.figures import write_figures
from integ_gym.eval.report.page import write_report

AN_ENTRY = re.compile(r"r\d+c\d+(s\d+e\d+)?")


@every_panel
def test_links_lead_to_what_is_there(name: str) -> None:
    panel, page = panel_of(name), page_of(name)
    ids, links = page.values("id"), page.values("href")
    assert len(ids) == len(set(ids))
    inner = {link[1:] for link in links if link.startswith("#")}
    assert {link for link in inner if not AN_ENTRY.fullmatch(link)} <= set(ids)
    for section, there in (
        ("verdicts", not panel.given_alone), ("remedy", panel.remedies),
        ("comparisons", panel.policy_comparisons), ("engines", panel.engine_agreement),
        ("checks", any(cell.kind == "varied" for cell in panel.cells)), ("paired", panel.paired),
    ):  # fmt: skip
        assert (section in ids) == (f"#{section}" in links) == bool(there)
    assert {"matrix", "conclude", "method", "reproduce"} <= set(ids)
    assert {"./panel.json", "./figures/"} <= set(links)


@every_panel
def test_a_page_loads_nothing_and_runs_its_own_script_alone(name: str) -> None:
    page, html = page_of(name), render(panel_of(name))
    assert page.values("src") == []
    assert all(link.startswith(("#", "./")) or link == "data:," for link in page.values("href"))
    assert not {tag for tag, _ in page.tags} & {"iframe", "img", "object", "embed", "base"}
    assert not {"url(", "@import"} & set(re.findall(r"url\(|@import", html))
    assert set(re.findall(r"https?://[^\"]*", html)) == {"http://www.w3.org/2000/svg"}
    (script,) = page.scripts
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = next(value for value in page.values("content") if "default-src" in value)
    assert f"script-src 'sha256-{digest}'" in policy
    assert "default-src 'none'" in policy
    assert not [a for _, attributes in page.tags for a in attributes if a.startswith("on")]


@every_panel
def test_every_entry_of_the_matrix_is_carried_and_every_grid_cell_has_its_place(name: str) -> None:
    panel, page = panel_of(name), page_of(name)
    head, _ = page.carried
    columns, links = {cell.name for cell in panel.columns}, set(page.values("href"))
    for entry in panel.matrix:
        anchor = panel.anchor(entry.row, entry.cell)
        carried = head["entries"][anchor[1:].replace("c", "/")]
        facts = dict(carried["facts"])
        assert facts["episodes"] == f"{entry.episodes:,}"
        status = (panel.cell(entry.cell).achievability or "").replace("_", " ")
        assert facts.get("the cell", "").startswith(status)
        assert name == "hostile" or shlex.split(carried["query"]) == shlex.split(entry.query)
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
    assert "49" not in page.text.split("Trained on × evaluated on")[0]
    files = page.carried[0]["files"].values()
    assert {"./javascript%3Aalert%281%29", "./evil.example/x"} <= set(files)
    assert all(link.startswith("./") for link in files)


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
    assert before.decode() == render(panel_of("given"))

    def broken(source: Path, target: Path) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("os.replace", broken)
    with pytest.raises(OSError, match="disk full"):
        write_report(panel_of("full"), tmp_path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def large_panel(rows: int, schemes: tuple[str, ...], steps: tuple[float, ...]) -> Panel:
    """Rows of one integrator each, of 56 seeds those of the family and of 10 the others."""
    dts = [0.05 / (k + 1) for k in range(-(-rows // 3))]

    def trained(seeds: int) -> list[dict[str, Any]]:
        return [line for dt in dts for line in example.trained(schemes[:3], seeds, dt)][:rows]

    lines = [*trained(56)[:3], *trained(10)[3:], *example.baselines(1)]
    panel = example.base_panel(lines, example.grid_cells(schemes, steps), 7)
    family = [(f"{name} dt=0.05", example.TRUTH) for name in schemes[:3]]
    panel["verdicts"] = example.judge(panel, family)
    return panel_from(panel)


SIZES = {
    "like the quick panel": (7, example.SCHEMES[:4], example.STEPS),
    "ten times larger": (24, example.SCHEMES, tuple(0.1 / (k + 1) for k in range(14))),
}


@pytest.mark.parametrize(
    ("size", "times"),
    [
        ("like the quick panel", 1),
        pytest.param("ten times larger", 3, marks=pytest.mark.slow),
    ],
)
def test_a_page_stays_light(
    size: str, times: int, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """Simulation and all; the larger one in a browser too."""
    panel = large_panel(*SIZES[size])
    html = render(panel, episodes_of(panel, example.EPISODES))
    assert len(html.encode()) <= times * MOST_BYTES
    assert len(Page(html).tags) <= times * MOST_NODES
    if times == 1:
        return
    assert len(panel.matrix) >= 10 * 190
    browser: Browser = request.getfixturevalue("browser")
    (tmp_path / "page.html").write_text(html, "utf-8")
    browser.open_report((tmp_path / "page.html").as_uri())
    assert browser.said == []
    assert browser.value("document.querySelectorAll('*').length") <= times * MOST_NODES
