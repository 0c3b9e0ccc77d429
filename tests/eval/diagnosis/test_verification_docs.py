"""docs/explanation/verification.md says what is measured."""

from __future__ import annotations

import doctest
import math
import re

import pytest
from checks import ROD, elliptic_pendulum
from house import ROOT

from integ_gym.envs.numerics.accuracy import convergence
from integ_gym.envs.numerics.energy import energies, energy_growth
from integ_gym.envs.numerics.identity import classify
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.oscillator import Oscillator
from integ_gym.envs.registries import INTEGRATORS

PAGE = ROOT / "docs" / "explanation" / "verification.md"
TEXT = PAGE.read_text(encoding="utf-8")


def _order(order: float | None) -> str:
    return "rounding" if order is None else f"{order:.1f}"


def _answer(holds: bool) -> str:
    return "yes" if holds else "no"


def _limit(h_omega: float) -> str:
    if math.isinf(h_omega):
        return "any"
    return f"{h_omega:.3f}" if h_omega else "never"


def row(name: str) -> str:
    """The row of an integrator in the table of measurements."""
    omega = math.sqrt(15.0)
    truth = elliptic_pendulum(math.pi / 2, omega, 0.5)
    order = convergence(name, ROD, (1.5 * math.pi, 0.0), 0.5, truth, omega).order
    pendulum, cart_pole = classify(name, ROD), classify(name, CartPole())
    growth = energy_growth(energies(name, Oscillator(), (1.0, 0.0), 0.1, 500))
    sign = "" if growth.kind == "bounded" else " growth" if growth.drift > 0 else " loss"
    cells = (
        f"`{name}`",
        _order(order),
        _order(cart_pole.order),
        _answer(pendulum.symplectic),
        _answer(cart_pole.symplectic),
        _answer(pendulum.reversible and cart_pole.reversible),
        _limit(pendulum.stable_up_to),
        growth.kind.replace("linear", "slow") + sign,
    )
    return f"| {' | '.join(cells)} |"


@pytest.mark.parametrize("name", INTEGRATORS.names())
def test_table_of_measurements(name):
    assert f"\n{row(name)}\n" in TEXT


def test_examples_run():
    assert doctest.testfile(str(PAGE), module_relative=False, encoding="utf-8").failed == 0


@pytest.mark.parametrize("path", sorted(set(re.findall(r"tests/[\w/]+\.py", TEXT))))
def test_files_exist(path):
    assert (ROOT / path).is_file()
