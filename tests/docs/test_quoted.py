"""Tables that pages quote are those of the files that they name, and none is left over."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from house import ROOT
from site_modules import loaded

PAGES = [
    page for page in (ROOT / "docs").rglob("*.md") if ", table 1 -->" in page.read_text("utf-8")
]
PUBLISHED = sorted((ROOT / "docs" / "atlas").glob("*/figures/tables.md"))
TABLE = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_has_the_tables_that_it_quotes(page: Path):
    text = page.read_text(encoding="utf-8")
    assert loaded("quoted").with_quotations(text, page.parent) == text


@pytest.mark.parametrize("file", PUBLISHED, ids=lambda file: file.parents[1].name)
def test_the_atlas_quotes_every_table_once(file: Path):
    text = (ROOT / "docs" / "explanation" / "atlas.md").read_text(encoding="utf-8")
    count = len(TABLE.findall(file.read_text(encoding="utf-8")))
    name = f"../atlas/{file.parents[1].name}/figures/tables.md"
    quoted = re.findall(rf"<!-- {re.escape(name)}, table (\d+) -->", text)
    assert quoted == [str(number + 1) for number in range(count)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_no_table_of_before_is_left(page: Path):
    text = page.read_text(encoding="utf-8")
    quoted, own = set(), []
    for found in TABLE.finditer(text):
        head = found.group().splitlines()[0]
        if text[: found.start()].endswith(" -->\n\n"):
            quoted.add(head)
        else:
            own.append(head)
    assert quoted
    assert not quoted & set(own)


def test_a_quotation_is_put_below_its_comment(tmp_path):
    (tmp_path / "t.md").write_text("| a |\n|---|\n\n| b |\n|---|\n", encoding="utf-8")
    put = loaded("quoted").with_quotations
    page = "One.\n\n<!-- t.md, table 2 -->\n\n{}Two.\n"
    for before in ("", "| old |\n", "| old |\n|---|\n\n"):
        assert put(page.format(before), tmp_path) == page.format("| b |\n|---|\n\n")
    with pytest.raises(ValueError, match=r"t\.md has no table 3, but 2"):
        put(page.format("").replace("2", "3"), tmp_path)
