"""Planted faults are caught by the checks that the suite itself runs."""

from __future__ import annotations

import mutants
import pytest
from checks import (
    LINEAR_MAPS,
    check_ledger,
    check_linear_map,
    check_order_on,
    check_order_on_the_pendulum,
    check_phase_space,
    check_solver,
)
from own_plants import CentralSpring
from plant_checks import (
    CLOSED_FORMS,
    check_closed_forms,
    check_equations_of_motion,
    check_plant,
    damped,
)

from integ_gym.envs.integrators.rk4 import RK4
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.registries import PLANTS

PLANT_CLASSES = [PLANTS.load(name) for name in PLANTS.names()]
OWNERS = [*PLANT_CLASSES, CentralSpring]
PLANT_FAULTS = [
    fault
    for owner in PLANT_CLASSES
    for method in ("acceleration", "energy", "dissipation", "jacobian", "mass_matrix")
    if hasattr(owner, method)
    for make in (mutants.sign_errors, mutants.wrong_numbers)
    for fault in make(owner, method)
] + [fault for owner in PLANT_CLASSES for fault in mutants.wrong_constants(owner)]
"""Every + and − and number of every equation and derived constant of every plant, wrong one at a
time."""


@pytest.mark.parametrize("owner", OWNERS, ids=lambda owner: owner.name)
def test_equations_of_motion(owner):
    check_equations_of_motion(damped(owner))


@pytest.mark.parametrize("owner", PLANT_CLASSES, ids=lambda owner: owner.name)
def test_closed_forms(owner):
    check_closed_forms(owner)


def test_every_equation_is_put_to_the_test():
    assert set(CLOSED_FORMS) == set(PLANTS.names())
    mutated = {fault.__mro__[1] for fault in PLANT_FAULTS}
    assert mutated == set(PLANT_CLASSES)


@pytest.mark.parametrize("fault", PLANT_FAULTS, ids=lambda fault: fault.__name__)
def test_any_wrong_sign_or_number_in_a_plant(fault):
    with pytest.raises(AssertionError):
        check_plant(fault)


@pytest.mark.parametrize(
    ("fault", "name"),
    [
        ("ExplicitForSymplectic", "symplectic_euler"),
        ("SymplecticForExplicit", "explicit_euler"),
        ("PositionFirst", "symplectic_euler"),
    ],
)
def test_swapped_euler_methods(fault, name):
    with pytest.raises(AssertionError):
        check_linear_map(f"mutants:{fault}", LINEAR_MAPS[name])


@pytest.mark.parametrize("fault", ["ExplicitForSymplectic", "SymplecticForExplicit"])
def test_swapped_euler_methods_in_phase_space(fault):
    with pytest.raises(AssertionError):
        check_phase_space(f"mutants:{fault}")


RK4_FAULTS = [
    mutants.reference(fault)
    for fault in (
        *mutants.wrong_numbers(RK4, "step"),
        *mutants.wrong_helper(RK4, "step", "_weighted"),
    )
]


@pytest.mark.parametrize("fault", RK4_FAULTS)
def test_any_wrong_weight_in_rk4(fault):
    with pytest.raises(AssertionError):
        check_order_on_the_pendulum(fault)
    with pytest.raises(AssertionError):
        check_linear_map(fault, LINEAR_MAPS["rk4"])


@pytest.mark.parametrize("fault", ["EulerOneIteration", "MidpointOneIteration"])
def test_newton_stopped_after_one_iteration(fault):
    with pytest.raises(AssertionError):
        check_solver(f"mutants:{fault}")


def test_newton_stopped_after_one_iteration_where_forces_depend_on_velocity():
    with pytest.raises(AssertionError):
        check_solver("mutants:VerletOneIteration")


def test_newton_stopped_after_one_iteration_in_phase_space():
    """Still reversible, and area-preserving on the pendulum: two degrees of freedom tell."""
    with pytest.raises(AssertionError):
        check_phase_space("mutants:MidpointOneIteration")


def test_verlet_with_explicit_kicks():
    with pytest.raises(AssertionError):
        check_order_on("mutants:ExplicitVerlet", CartPole())


@pytest.mark.parametrize("owner", [Pendulum, CartPole], ids=lambda p: p.name)
def test_ledger_without_damping(owner):
    with pytest.raises(AssertionError):
        check_ledger("rk4", mutants.without_booked_damping(owner)(damping=0.3))


@pytest.mark.parametrize("fault", ["RectangleLedger", "TrapezoidLedger"])
def test_ledger_summed_beside_the_stages(fault):
    with pytest.raises(AssertionError):
        check_ledger(f"mutants:{fault}", Pendulum(damping=0.3))
