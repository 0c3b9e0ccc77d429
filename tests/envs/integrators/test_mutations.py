"""Planted faults are caught by the checks that the suite itself runs."""

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
    CLOSED_FORMS_PLACE,
    check_closed_forms,
    check_equations_of_motion,
    check_plant,
    damped,
)
from stated import check_table

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
    check_table(CLOSED_FORMS, PLANTS.names(), CLOSED_FORMS_PLACE)
    mutated = {fault.__mro__[1] for fault in PLANT_FAULTS}
    assert mutated == set(PLANT_CLASSES)


@pytest.mark.parametrize("fault", PLANT_FAULTS, ids=lambda fault: fault.__name__)
def test_any_wrong_sign_or_number_in_a_plant(fault):
    with pytest.raises(AssertionError):
        check_plant(fault)


RK4_FAULTS = [
    mutants.reference(fault)
    for fault in (
        *mutants.wrong_numbers(RK4, "step"),
        *mutants.wrong_helper(RK4, "step", "_weight_stages"),
    )
]


@pytest.mark.parametrize("fault", RK4_FAULTS)
def test_any_wrong_weight_in_rk4(fault):
    with pytest.raises(AssertionError):
        check_order_on_the_pendulum(fault)
    with pytest.raises(AssertionError):
        check_linear_map(fault, LINEAR_MAPS["rk4"])


CAUGHT = [
    (check_linear_map, "mutants:ExplicitForSymplectic", LINEAR_MAPS["symplectic_euler"]),
    (check_linear_map, "mutants:SymplecticForExplicit", LINEAR_MAPS["explicit_euler"]),
    (check_linear_map, "mutants:PositionFirst", LINEAR_MAPS["symplectic_euler"]),
    (check_phase_space, "mutants:ExplicitForSymplectic"),
    (check_phase_space, "mutants:SymplecticForExplicit"),
    (check_phase_space, "mutants:MidpointOneIteration"),
    (check_solver, "mutants:EulerOneIteration"),
    (check_solver, "mutants:MidpointOneIteration"),
    (check_solver, "mutants:VerletOneIteration"),
    (check_order_on, "mutants:ExplicitVerlet", CartPole()),
    (check_ledger, "rk4", mutants.without_booked_damping(Pendulum)(damping=0.3)),
    (check_ledger, "rk4", mutants.without_booked_damping(CartPole)(damping=0.3)),
    (check_ledger, "mutants:RectangleLedger", Pendulum(damping=0.3)),
    (check_ledger, "mutants:TrapezoidLedger", Pendulum(damping=0.3)),
]
"""Swapped methods, Newton stopped after one iteration, kicks at known velocities, and ledgers that
lack damping or sum it beside the stages."""


@pytest.mark.parametrize(("check", "fault", "more"), [(c, f, more) for c, f, *more in CAUGHT])
def test_a_planted_fault_is_caught(check, fault, more):
    with pytest.raises(AssertionError):
        check(fault, *more)
