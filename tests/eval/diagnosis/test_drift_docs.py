"""docs/explanation/drift.md says what is measured."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from checks import POINT
from stated import stated

from integ_gym.envs.numerics.energy import energies
from integ_gym.envs.numerics.stepping import linear_map, stability_limit
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

TEXT = (Path(__file__).parents[3] / "docs" / "explanation" / "drift.md").read_text(encoding="utf-8")
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


FACTORS = {
    "1 + z², exactly, in every state": lambda z: 1.0 + z**2,
    "1 / (1 + z²), exactly, in every state": lambda z: 1.0 / (1.0 + z**2),
    "1 − z⁶/72 + z⁸/576, exactly, in every state": lambda z: 1.0 - z**6 / 72.0 + z**8 / 576.0,
    "1": lambda z: 1.0,
    "1; conserves the energy itself": lambda z: 1.0,
}
LIMITS = {
    "z = 0: never": 0.0, "every z": math.inf, "z = 2√2": 2.0 * math.sqrt(2.0), "z = 2": 2.0,
}  # fmt: skip


@pytest.mark.parametrize("row", OSCILLATOR, ids=lambda row: row[0].replace("`", ""))
@pytest.mark.parametrize("z", [0.1, 1.0, 1.9])
def test_energy_factor_of_the_oscillator(row, z):
    for name in _names(row[0]):
        step = linear_map(name, z)
        assert step.spectral_radius**2 == pytest.approx(FACTORS[row[1]](z), rel=1e-12)
        assert stability_limit(name) == pytest.approx(LIMITS[row[2]], abs=1e-9)
        exact = math.isclose(*step.energy_multipliers, rel_tol=1e-12)
        assert exact is ("every state" in row[1] or "itself" in row[1])
