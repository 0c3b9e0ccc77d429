"""docs/explanation/drift.md says what is measured."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from checks import POINT
from house import page_text
from stated import stated

from integ_gym.envs.numerics.energy import energies
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.registries import INTEGRATORS
from integ_gym.eval.diagnosis.drift import (
    CART_POLE_DT,
    CART_POLE_INTEGRATORS,
    CART_POLE_TIMES,
    DT,
    DURATION,
    RELEASE,
)

TEXT = page_text("docs/explanation/drift.md")
ROUNDING = 1e-9
"""Percent."""


def _rows(heading: str) -> list[list[str]]:
    """Cells of the table under a heading, without its first two lines."""
    section = TEXT.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def _names(cell: str) -> list[str]:
    return re.findall(r"`(\w+)`", cell)


def _percent(cell: str):
    """What a cell states; zeros that end a whole number of thousands only give its size."""
    if cell == "rounding":
        return pytest.approx(0.0, abs=ROUNDING)
    number = re.fullmatch(r"([+−]?)([\d .]+) %", cell)
    assert number, cell
    digits = number[2].replace(" ", "")
    kept = digits if len(digits) < 5 or "." in digits else digits.rstrip("0")
    text = f"{number[1].replace('−', '-')}{kept}"
    return stated(f"{text}e{len(digits) - len(kept)}" if kept != digits else text)


PENDULUM = _rows("What 200 s do to its energy")
OSCILLATOR = _rows("Why")
CART_POLE = _rows("What the names do not promise")


def test_tables_have_every_integrator():
    assert {_names(row[0])[0] for row in PENDULUM} == set(INTEGRATORS.names())
    assert {name for row in OSCILLATOR for name in _names(row[0])} == set(INTEGRATORS.names()) - {
        "reference"
    }
    assert [_names(row[0])[0] for row in CART_POLE] == list(CART_POLE_INTEGRATORS)


@pytest.mark.parametrize("row", PENDULUM, ids=lambda row: row[0].strip("`"))
def test_drift_of_the_pendulum(row):
    energy = energies(_names(row[0])[0], POINT, (math.pi - RELEASE, 0.0), DT, round(DURATION / DT))
    change = 100.0 * (energy / energy[0] - 1.0)
    assert change[-1] == _percent(row[1])
    assert np.abs(change).max() == _percent(row[2])


@pytest.mark.parametrize("row", CART_POLE, ids=lambda row: row[0].strip("`"))
def test_drift_of_the_cart_pole(row):
    steps = [round(time / CART_POLE_DT) for time in CART_POLE_TIMES]
    start = (0.0, 0.0, math.pi - RELEASE, 0.0)
    energy = energies(_names(row[0])[0], CartPole(), start, CART_POLE_DT, steps[-1])
    for k, cell in zip(steps, row[1:], strict=True):
        assert 100.0 * (energy[k] / energy[0] - 1.0) == _percent(cell)
