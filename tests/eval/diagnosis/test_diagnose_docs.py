"""docs/reference/diagnose.md says what `integ-gym diagnose` prints and writes."""

from __future__ import annotations

import re
from pathlib import Path

from integ_gym.eval.diagnosis.run import SECTIONS

PAGE = (Path(__file__).parents[3] / "docs" / "reference" / "diagnose.md").read_text(
    encoding="utf-8"
)


def _blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


def _plain(row: str) -> str:
    """A row without its blanks, and without what rounding alone decides."""
    return re.sub(r"[\d.]+·10⁻¹[⁰¹²³⁴⁵⁶⁷⁸⁹](?= )", "rounding", " ".join(row.split()))


def test_the_table_is_what_is_printed(diagnosis):
    _, _, printed = diagnosis
    rows = {_plain(row) for row in printed.splitlines()}
    (block,) = _blocks("text")
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
