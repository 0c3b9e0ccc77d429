"""The measuring functions, on maps whose properties are known, and on a user's own classes."""

import math

import numpy as np
import pytest

from integ_gym.envs.engines import maps
from integ_gym.envs.integrators.interface import Step
from integ_gym.envs.numerics.accuracy import (
    convergence,
    independent_motion,
    reversibility_errors,
    volume_defect,
)
from integ_gym.envs.numerics.energy import energies, energy_growth
from integ_gym.envs.numerics.identity import Declared, classify, declared
from integ_gym.envs.numerics.stepping import advance
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.registries import INTEGRATORS

NAMES = INTEGRATORS.names()


class Heun(maps.Heun):
    """Declares a third order that it does not have."""

    order, symplectic, reversible = 3, None, None


class Overflowing:
    """Raises what Python raises where an array would hold an infinity."""

    def step(self, ops, system, q, v, losses, control, dt):
        return Step((q[0] + 1e200**2,), v, losses)


OWN = f"{__name__}:Heun"


@pytest.mark.parametrize("name", NAMES)
def test_every_integrator_is_what_it_declares(name):
    """On the pendulum; on the cart-pole no other than the reference is symplectic."""
    found = classify(name)
    assert found.contradictions(declared(name)) == ()
    if name == "reference":
        assert (found.order, found.symplectic, found.stable_up_to) == (None, True, math.inf)
    elif declared(name).symplectic:
        assert classify(name, CartPole()).contradictions(declared(name)) == ("symplectic",)


def test_own_integrator():
    found = classify(OWN)
    assert found.order == pytest.approx(2.0, abs=0.05)
    assert (found.symplectic, found.reversible, found.stable_up_to) == (False, False, 0.0)
    assert declared(OWN) == Declared(3, None, None)
    assert found.contradictions(declared(OWN)) == ("order",)


def test_volume_shrinks_by_the_damping():
    """det of the exact flow is exp(−b h / I)."""
    plant = Pendulum(damping=0.2)
    found = volume_defect("reference", plant, (1.0, 2.0), 0.1)
    assert found == pytest.approx(math.expm1(-0.2 / plant.inertia * 0.1), abs=1e-9)


def test_independent_motion_books_work_and_loss():
    """A damped oscillator under a constant force: what it ends with is known."""
    plant = Pendulum(gravity=0.0, damping=0.5)
    motion = independent_motion(plant, (0.0, 0.0), [0.3] * 200, 0.1)
    speed = 0.3 / 0.5
    assert motion.states[-1, 1] == pytest.approx(speed, rel=1e-9)
    assert motion.work[-1] == pytest.approx(0.3 * motion.states[-1, 0], rel=1e-12)
    kinetic = 0.5 * plant.inertia * speed**2
    assert motion.energy[-1] - motion.energy[0] == pytest.approx(kinetic, rel=1e-9)
    assert motion.lost[-1] == pytest.approx(motion.work[-1] - kinetic, rel=1e-9)
    assert (np.diff(motion.lost) > 0.0).all()


def test_arithmetic_errors_are_not_a_number():
    own = f"{__name__}:Overflowing"
    assert np.isnan(advance(own, Pendulum(), (1.0, 0.0), 0.05)).all()
    assert np.isnan(energies(own, Pendulum(), (1.0, 0.0), 0.05, 3)[1:]).all()
    assert math.isnan(reversibility_errors(own, Pendulum(), (1.0, 0.0), 0.05).max())
    assert energy_growth(energies(own, Pendulum(), (1.0, 0.0), 0.05, 30)).drift == math.inf


LADDER = (4, 5, 6, 12, 13)
"""Errors of the last two steps are rounding."""


def test_convergence_is_measured_above_rounding_only():
    found = convergence("rk4", Pendulum(), (math.pi - 1.0, 0.0), frequency=4.0, halvings=LADDER)
    assert found.order == pytest.approx(4.0, abs=0.05)
    assert found.steps_s[0] == 0.5 / 16
    assert len(found.errors) == len(LADDER)


TIME = np.linspace(0.0, 50.0, 2001)


@pytest.mark.parametrize(
    ("energy", "kind", "drift"),
    [
        (2.0 + 0.1 * np.sin(7.0 * TIME), "bounded", 0.0),
        (2.0 + 1e-13 * TIME, "bounded", 0.0),
        (2.0 + 0.04 * TIME + 0.01 * np.sin(7.0 * TIME), "linear", 0.88),
        (2.0 - 0.0001 * TIME, "linear", -0.00225),
        (2.0 * np.exp(0.05 * TIME), "exponential", math.exp(2.25) - 1.0),
        (2.0 * np.exp(-0.05 * TIME), "exponential", math.exp(-2.25) - 1.0),
    ],
)
def test_energy_growth(energy, kind, drift):
    found = energy_growth(energy)
    assert found.kind == kind
    assert found.drift == pytest.approx(drift, rel=0.03, abs=5e-3 if kind == "bounded" else 0.0)
    assert found.largest == pytest.approx(np.abs(energy / energy[0] - 1.0).max())
