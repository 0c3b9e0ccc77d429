"""The tables and figures of the pages on engines and on trust are what is declared and measured."""

from __future__ import annotations

from pathlib import Path

import pytest
from engine_cases import native_name

from integ_gym.envs.engines.maps import map_names
from integ_gym.envs.numerics.identity import fingerprint

ROOT = Path(__file__).parents[3]
TRUST_PAGE = (ROOT / "docs" / "explanation" / "trust.md").read_text(encoding="utf-8")


ROUNDING = 1e-10
"""Changes of volume below it are called zero."""


def _row(page, name):
    """Cells of the only table row that begins with a name in code style."""
    (row,) = [line for line in page.splitlines() if line.startswith(f"| `{name}` |")]
    return row.strip("| ").split(" | ")


def _percent(share, digits=3):
    shown = round(100.0 * share, digits)
    return f"{shown:+.{digits}f}".replace("-", "−") + " %" if shown else "0 %"


def _volume(defect):
    return (
        f"{defect:+.0e}".replace("-", "−").replace("e−0", "e−") if abs(defect) > ROUNDING else "0"
    )


@pytest.mark.parametrize("name", map_names())
def test_the_table_of_trust_is_what_the_fingerprint_measures(name):
    told = [fingerprint("native", native_name(name), plant) for plant in ("pendulum", "cart_pole")]
    order = round(told[0].order)
    assert all(found.order == pytest.approx(order, abs=0.1) for found in told)
    small = [
        cell
        for found in told
        for cell in (_percent(found.frequency_shift), _percent(found.energy_rate) + "/s")
    ]
    assert _row(TRUST_PAGE, name) == [
        f"`{name}`", str(order), *small, _volume(told[1].volume_defect),
    ]  # fmt: skip
