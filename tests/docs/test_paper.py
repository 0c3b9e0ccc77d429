"""The paper: what it cites, shows and names exists, and its numbers are the published ones."""

from __future__ import annotations

import json
import re

import pyarrow.parquet as pq
import yaml
from house import ROOT

PAPER = (ROOT / "paper.md").read_text(encoding="utf-8")
BODY = " ".join(PAPER.split("---\n", 2)[2].split())


def test_every_reference_is_cited_and_every_citation_has_one():
    entries = re.findall(r"^@\w+\{(\w+),", (ROOT / "paper.bib").read_text(encoding="utf-8"), re.M)
    assert set(re.findall(r"@(\w+\d{4}|simbenchmark)", BODY)) == set(entries)
    assert len(entries) == len(set(entries))


def test_what_it_names_exists():
    for path in re.findall(r"\]\(([^)]+)\)|`(docs/[^`]+)`", BODY):
        assert (ROOT / "".join(path)).exists(), path
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"`make (\w+)`", BODY):
        assert f"\n{target}:" in makefile, target


def test_it_names_the_authors_and_the_title_of_the_citation():
    head = yaml.safe_load(PAPER.split("---\n")[1])
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert head["title"] == citation["title"]
    assert [one["name"] for one in head["authors"]] == [one["name"] for one in citation["authors"]]


def test_its_numbers_are_those_of_the_published_panel():
    saved = json.loads((ROOT / "docs" / "quick_panel.json").read_text(encoding="utf-8"))
    rows = {row["row"]: row for row in saved["rows"]}
    lossy, truth = rows["symplectic_euler dt=0.05"], "reference dt=0.05"
    home, there = (
        "{:.2f} ({:.2f} to {:.2f})".format(*rate)
        for rate in (lossy["home"], lossy["cells"][truth]["success"])
    )
    assert f"succeed in {home} of episodes there and in {there} on the truth" in BODY
    assert rows[truth]["cells"][truth]["success"][0] > 0.995
    assert abs(rows["explicit_euler dt=0.0125"]["cells"][truth]["success"][0] - 1.0) < 0.005


def test_its_numbers_are_those_of_the_published_engines():
    rows = pq.read_table(ROOT / "docs" / "tables" / "learned_engines" / "rows.parquet").to_pylist()

    def lost(arm: str) -> float:
        own = [row for row in rows if (row["task"], row["arm"]) == ("swing-up", arm)]
        home, away = (
            [row["successes"] / row["starts"] for row in own if is_home == at_home(row)]
            for is_home in (True, False)
        )
        return sum(home) / len(home) - sum(away) / len(away)

    def at_home(row: dict[str, object]) -> bool:
        return row["trained_on"] == row["judged_on"]

    assert f"lose {lost('as got'):.2f} of success in the five others" in BODY
    assert f"same step in all engines they lose {lost('matched'):z.2f}." in BODY


def test_its_numbers_are_those_of_the_published_control_periods():
    table = pq.read_table(ROOT / "docs" / "tables" / "learned_periods" / "rows.parquet")
    wanted = {"task": "pendulum", "algorithm": "PPO", "arm": "per second", "delay": 0}

    def success(period: float) -> float:
        at = {**wanted, "trained_at": period, "judged_at": period}
        own = [row for row in table.to_pylist() if at.items() <= row.items()]
        return sum(row["successes"] for row in own) / sum(row["starts"] for row in own)

    reached = f"{success(0.2):.2f} and {success(0.0125):.2f}"
    assert f"it reaches {reached} (p = 0.001 and p < 0.001" in BODY
