"""docs/explanation/verification.md and drift.md say what is measured."""

from __future__ import annotations

import doctest
import math

import numpy as np
import pytest
from checks import POINT, ROD, elliptic_pendulum
from house import ROOT, page_text
from stated import stated

from integ_gym.envs.numerics.accuracy import convergence
from integ_gym.envs.numerics.energy import energies, energy_growth
from integ_gym.envs.numerics.identity import classify
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.oscillator import Oscillator
from integ_gym.envs.registries import INTEGRATORS
from integ_gym.eval.diagnosis import drift

PAGE = ROOT / "docs" / "explanation" / "verification.md"
TEXT = PAGE.read_text(encoding="utf-8")


def row(name: str) -> str:
    """The row of an integrator in the table of measurements."""
    omega = math.sqrt(15.0)
    truth = elliptic_pendulum(math.pi / 2, omega, 0.5)
    order = convergence(name, ROD, (1.5 * math.pi, 0.0), 0.5, truth, omega).order
    pendulum, cart_pole = classify(name, ROD), classify(name, CartPole())
    growth = energy_growth(energies(name, Oscillator(), (1.0, 0.0), 0.1, 500))
    sign = "" if growth.kind == "bounded" else " growth" if growth.drift > 0 else " loss"
    limit = pendulum.stable_up_to
    answer = {True: "yes", False: "no"}
    cells = (
        f"`{name}`",
        *("rounding" if p is None else f"{p:.1f}" for p in (order, cart_pole.order)),
        *(answer[found.symplectic] for found in (pendulum, cart_pole)),
        answer[pendulum.reversible and cart_pole.reversible],
        "any" if math.isinf(limit) else f"{limit:.3f}" if limit else "never",
        growth.kind.replace("linear", "slow") + sign,
    )
    return f"| {' | '.join(cells)} |"


@pytest.mark.parametrize("name", INTEGRATORS.names())
def test_table_of_measurements(name):
    assert f"\n{row(name)}\n" in TEXT


def test_examples_run():
    assert doctest.testfile(str(PAGE), module_relative=False, encoding="utf-8").failed == 0


def _changes(heading: str):
    """Integrators and shares of energy, percent, in a table of drift.md."""
    section = page_text("docs/explanation/drift.md").split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| `")]
    for row in rows:
        name, *cells = (cell.strip() for cell in row.strip("|").split("|"))
        numbers = [cell for cell in cells if cell == "rounding" or cell.endswith("%")]
        yield name.split("`")[1], [_percent(cell) for cell in numbers]


def _percent(cell: str):
    """What a cell states; zeros that end a whole number of thousands only give its size."""
    if cell == "rounding":
        return pytest.approx(0.0, abs=1e-9)
    digits = cell.removesuffix(" %").replace("−", "-").replace(" ", "")
    kept = digits if len(digits.lstrip("+-")) < 5 or "." in digits else digits.rstrip("0")
    return stated(kept if kept == digits else f"{kept}e{len(digits) - len(kept)}")


def test_drift_of_the_pendulum():
    rows = dict(_changes("What 200 s do to its energy"))
    assert set(rows) == set(INTEGRATORS.names())
    start, steps = (math.pi - drift.RELEASE, 0.0), round(drift.DURATION / drift.DT)
    for name, (end, largest) in rows.items():
        energy = energies(name, POINT, start, drift.DT, steps)
        change = 100.0 * (energy / energy[0] - 1.0)
        assert change[-1] == end, name
        assert np.abs(change).max() == largest, name


def test_drift_of_the_cart_pole():
    """Over 10 s and 100 s; over 1000 s in `test_drift.py`."""
    rows = dict(_changes("What the names do not promise"))
    assert list(rows) == list(drift.CART_POLE_INTEGRATORS)
    steps = [round(time / drift.CART_POLE_DT) for time in drift.CART_POLE_TIMES[:2]]
    start = (0.0, 0.0, math.pi - drift.RELEASE, 0.0)
    for name, shown in rows.items():
        energy = energies(name, CartPole(), start, drift.CART_POLE_DT, steps[-1])
        for k, share in zip(steps, shown[:2], strict=True):
            assert 100.0 * (energy[k] / energy[0] - 1.0) == share, name
