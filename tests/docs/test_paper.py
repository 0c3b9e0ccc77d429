"""The paper: its references, figures and commands exist, and its numbers are those of the published run."""

from __future__ import annotations

import json
import re

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
