"""docs/reference/diagnose.md says what `integ-gym diagnose` prints and writes."""

from __future__ import annotations

import re

from house import page_blocks, page_text

from integ_gym.eval.diagnosis.run import SECTIONS

PAGE = page_text("docs/reference/diagnose.md")


def _plain(row: str) -> str:
    """A row without its blanks, and without what rounding alone decides."""
    return re.sub(r"[\d.]+·10⁻¹[⁰¹²³⁴⁵⁶⁷⁸⁹](?= )", "rounding", " ".join(row.split()))


def test_the_table_is_what_is_printed(diagnosis):
    _, _, printed = diagnosis
    rows = {_plain(row) for row in printed.splitlines()}
    (block,) = page_blocks("docs/reference/diagnose.md", "text")
    checked = [_plain(row) for row in block.splitlines() if row.strip("- ")]
    assert len(checked) > 15
    for row in checked:
        assert row in rows


def test_every_section_is_explained():
    explained = re.findall(r"^\*\*([a-z ]+)\.\*\*", PAGE, re.MULTILINE)
    assert explained == list(SECTIONS)


def test_every_field_is_explained(diagnosis):
    out, result, _ = diagnosis
    fields = set(result) | set(result["findings"][0]) | set(result["plants"][0])
    fields |= set(result["identities"][0]) - {"plant", "integrator"}
    for field in fields:
        assert f"`{field}`" in PAGE, field
    for figure in (out / "figures").glob("*.png"):
        name = "contact_PLANT" if figure.stem.startswith("contact_") else figure.stem
        assert f"`{name}.png`" in PAGE
