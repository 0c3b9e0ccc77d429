"""Every integrator is what it says: order, one-step map, phase space, reversibility, solver."""

import math
from itertools import product

import gymnasium as gym
import numpy as np
import pytest
from checks import (
    ALL,
    APPROXIMATE,
    LINEAR_MAPS,
    LINEAR_MAPS_PLACE,
    NEWTON,
    POINT,
    ROD,
    check_ledger,
    check_linear_map,
    check_order_on,
    check_order_on_the_pendulum,
    check_phase_space,
    check_reversibility,
    check_solver,
    elliptic_pendulum,
    registered_plants,
)
from motions import DRIVEN_PLANTS
from own_plants import CentralSpring, PolarElasticPendulum
from pairing import pairs
from stated import by_hand, check_table, stated

from integ_gym.envs.engines.maps import Tableau, map_names, one_step_map
from integ_gym.envs.integrators import newton as _newton
from integ_gym.envs.numerics.accuracy import (
    reversibility_errors,
    symplecticity_defect,
    volume_defect,
)
from integ_gym.envs.numerics.identity import declared
from integ_gym.envs.numerics.stepping import advance, linear_map, stability_limit
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.elastic_pendulum import ElasticPendulum
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import INTEGRATORS, MAPS

PLACE = "tests/envs/integrators/test_integrators.py"
OF_ENGINES = [f"{owner.__module__}:{owner.__name__}" for owner in map(MAPS.load, MAPS.names())]
"""Maps beside the integrators, which engines apply."""
MEASURED = [name for name in OF_ENGINES if declared(name).order < 5]
"""Above order 4, rounding hides the errors before their slope has settled."""
DECLARED = [*APPROXIMATE, *(name for name in OF_ENGINES if declared(name).symplectic is not None)]

CART_POLE_STATE = (0.1, 0.3, 2.0, 3.0)
"""(x, ẋ, θ, θ̇) at which the failures on the cart-pole were recorded, h = 0.02."""

DAMPED_PLANTS = [*DRIVEN_PLANTS.values(), CentralSpring(damping=0.3)]

POLAR_STATE = (1.2, 0.5, 0.8, 2.0)
"""(r, ṙ, φ, φ̇), h = 0.05."""


def _pendulum_rk4(q, v, h):
    def f(q, v):
        return v, 15.0 * math.sin(q)

    k1, l1 = f(q, v)
    k2, l2 = f(q + h / 2 * k1, v + h / 2 * l1)
    k3, l3 = f(q + h / 2 * k2, v + h / 2 * l2)
    k4, l4 = f(q + h * k3, v + h * l3)
    return q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), v + h / 6 * (l1 + 2 * l2 + 2 * l3 + l4)


EXPLICIT_STEPS = {
    "explicit_euler": lambda q, v, h: (q + h * v, v + h * 15.0 * math.sin(q)),
    "symplectic_euler": lambda q, v, h: (
        q + h * v + h * h * 15.0 * math.sin(q),
        v + h * 15.0 * math.sin(q),
    ),
    "stormer_verlet": lambda q, v, h: (
        q1 := q + h * v + h * h / 2 * 15.0 * math.sin(q),
        v + h / 2 * 15.0 * (math.sin(q) + math.sin(q1)),
    ),
    "rk4": _pendulum_rk4,
}
"""One step of θ̈ = 15 sin θ, by hand."""

IMPLICIT_STEPS = {
    "implicit_euler": lambda q, v, q1, v1, h: (q + h * v1 - q1, v + h * 15.0 * math.sin(q1) - v1),
    "implicit_midpoint": lambda q, v, q1, v1, h: (
        q + h * (v + v1) / 2 - q1,
        v + h * 15.0 * math.sin((q + q1) / 2) - v1,
    ),
}
"""What vanishes for one step of θ̈ = 15 sin θ, by hand."""


SOLVING = [name for name in ALL if hasattr(INTEGRATORS.load(name), "solver_cap")]
TABLES = {
    LINEAR_MAPS_PLACE: (LINEAR_MAPS, ALL),
    f"EXPLICIT_STEPS or IMPLICIT_STEPS of {PLACE}": (
        [*EXPLICIT_STEPS, *IMPLICIT_STEPS, "reference"],
        ALL,
    ),
    "NEWTON of tests/helpers/envs/checks.py": ([*NEWTON, "reference"], SOLVING),
}
"""Names that have an entry and names that need one, by the table's place."""


@pytest.mark.parametrize("place", TABLES)
def test_every_integrator_is_written_by_hand(place):
    check_table(*TABLES[place], place)


@pytest.mark.parametrize("integrator", ALL)
def test_one_step_on_the_oscillator(integrator):
    check_linear_map(integrator, by_hand(LINEAR_MAPS, integrator, LINEAR_MAPS_PLACE))


@pytest.mark.parametrize("integrator", [*EXPLICIT_STEPS, *IMPLICIT_STEPS])
def test_one_step_on_the_pendulum(integrator):
    for state in ((0.3, -1.0), (2.0, 1.5), (-4.0, 6.0)):
        for dt in (0.05, 0.01):
            found = advance(integrator, ROD, state, dt)
            if integrator in EXPLICIT_STEPS:
                defect = np.subtract(found, EXPLICIT_STEPS[integrator](*state, dt))
            else:
                defect = IMPLICIT_STEPS[integrator](*state, *found, dt)
            np.testing.assert_allclose(defect, 0.0, rtol=0, atol=1e-13)


@pytest.mark.parametrize("amplitude", [0.5, 1.5, 3.0])
def test_reference_is_the_elliptic_solution(amplitude):
    truth = elliptic_pendulum(amplitude, math.sqrt(15.0), 2.0)
    found = advance("reference", ROD, (math.pi + amplitude, 0.0), 0.05, 40)
    np.testing.assert_allclose(found, truth, rtol=0, atol=1e-10)


@pytest.mark.parametrize("integrator", [*APPROXIMATE, *MEASURED])
def test_order_against_the_elliptic_solution(integrator):
    check_order_on_the_pendulum(integrator)


@pytest.mark.parametrize(
    ("integrator", "plant"),
    [
        *product(APPROXIMATE, DAMPED_PLANTS),
        *((name, DRIVEN_PLANTS["cart_pole"]) for name in MEASURED),
    ],
)
def test_order_on_every_plant(integrator, plant):
    """Driven and damped, with Coriolis terms where the plant has them."""
    check_order_on(integrator, plant, control=0.7)


@pytest.mark.parametrize("integrator", DECLARED)
def test_phase_space_and_reversibility(integrator):
    check_phase_space(integrator)
    check_reversibility(integrator)


@pytest.mark.parametrize("integrator", ["explicit_euler", "implicit_euler", "rk4"])
def test_volume_change_on_the_pendulum(integrator):
    """det J = 1 + h²ω²cos φ and 1/(1 + h²ω²cos φ₁) by hand, φ from hanging; as recorded."""
    h, state, torque = 0.05, (math.pi - 0.685, -2.0), 2.0
    found = volume_defect(integrator, ROD, state, h, torque)
    end = advance(integrator, ROD, state, h, 1, torque)[0]
    if integrator == "explicit_euler":
        assert found == pytest.approx(h * h * 15.0 * math.cos(0.685), abs=1e-9)
    if integrator == "implicit_euler":
        assert found == pytest.approx(1 / (1 - h * h * 15.0 * math.cos(end)) - 1, abs=1e-9)
    recorded = {"explicit_euler": "2.90e-2", "implicit_euler": "-2.68e-2", "rk4": "-2.57e-7"}
    assert found == stated(recorded[integrator])


@pytest.mark.parametrize(
    ("integrator", "volume", "canonical"),
    [
        ("symplectic_euler", "-4.8e-4", "1.1e-2"),
        ("mutants:ExplicitVerlet", "-7.9e-5", "4.0e-3"),
        ("implicit_midpoint", "2.4e-7", "1.2e-4"),
    ],
)
def test_names_do_not_make_the_cart_pole_symplectic(integrator, volume, canonical):
    arguments = (integrator, CartPole(), CART_POLE_STATE, 0.02)
    assert volume_defect(*arguments) == stated(volume)
    assert symplecticity_defect(*arguments) == stated(canonical)


@pytest.mark.parametrize(
    ("plant", "state", "dt"),
    [(CartPole(), CART_POLE_STATE, 0.02), (PolarElasticPendulum(), POLAR_STATE, 0.05)],
)
def test_the_reference_is_symplectic_to_rounding_whatever_the_mass_matrix(plant, state, dt):
    assert symplecticity_defect("reference", plant, state, dt) < 1e-10


def test_symplectic_euler_does_not_come_back():
    defect = reversibility_errors("symplectic_euler", POINT, (math.pi / 2, 0.0), 0.05).max()
    assert defect == stated("0.337")


@pytest.mark.parametrize("integrator", ["stormer_verlet", "implicit_midpoint"])
def test_reversible_on_the_cart_pole_too(integrator):
    start = (0.0, 0.0, math.pi - 0.5, 0.0)
    assert reversibility_errors(integrator, CartPole(), start, 0.02).max() < 1e-13


@pytest.mark.parametrize("h", [0.01, 0.3, 1.5])
def test_linear_energy_laws(h):
    gain = 1.0 + h * h
    assert linear_map("explicit_euler", h).energy_multipliers == pytest.approx((gain, gain), 1e-12)
    lost = 1.0 / gain
    assert linear_map("implicit_euler", h).energy_multipliers == pytest.approx((lost, lost), 1e-12)
    kept = linear_map("implicit_midpoint", h).energy_multipliers
    assert kept == pytest.approx((1.0, 1.0), 1e-12)
    law = 1.0 - h**6 / 72.0 + h**8 / 576.0
    assert linear_map("rk4", h).energy_multipliers == pytest.approx((law, law), 1e-12)


@pytest.mark.parametrize("h", [0.01, 0.3, 1.5, 1.99])
def test_conserved_modified_energies(h):
    """½(v² + x² − h x v) for symplectic Euler, ½(v² + (1 − h²/4) x²) for Verlet, exactly."""
    forms = {
        "symplectic_euler": [[1.0, -h / 2], [-h / 2, 1.0]],
        "stormer_verlet": [[1.0 - h * h / 4, 0.0], [0.0, 1.0]],
        "implicit_midpoint": [[1.0, 0.0], [0.0, 1.0]],
    }
    for integrator, form in forms.items():
        step = np.array(linear_map(integrator, h).matrix)
        np.testing.assert_allclose(step.T @ np.array(form) @ step, form, rtol=0, atol=1e-12)


STABILITY = {
    "explicit_euler": 0.0,
    "symplectic_euler": 2.0,
    "stormer_verlet": 2.0,
    "rk4": 2.0 * math.sqrt(2.0),
    "implicit_euler": math.inf,
    "implicit_midpoint": math.inf,
    "reference": math.inf,
}


@pytest.mark.parametrize("integrator", ALL)
def test_stability_limit(integrator):
    expected = by_hand(STABILITY, integrator, f"STABILITY of {PLACE}")
    assert stability_limit(integrator) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("integrator", NEWTON)
def test_solver(integrator):
    check_solver(integrator)


@pytest.mark.parametrize("integrator", NEWTON)
def test_solver_at_its_cap(integrator):
    """A step that the cap cuts short says so, in a single and in a vector environment."""
    solver = {"iterations": 1}
    arguments = {"integrator": integrator, "dt": 0.05, "damping": 0.05, "solver": solver}
    single = gym.make("IntegCartPole-v0", disable_env_checker=True, **arguments)
    single.reset(options={"state": (0.0, 1.0, 1.0, 5.0)})
    *_, info = single.step(1)
    assert info["solver_status"] == "not_converged"
    assert info["solver_iterations"] == 1
    assert info["solver_residual"] > _newton.TOLERANCE
    vector = gym.make_vec("IntegCartPole-v0", num_envs=2, **arguments)
    vector.reset(options={"state": np.tile([0.0, 1.0, 1.0, 5.0], (2, 1))})
    *_, infos = vector.step(np.ones(2, dtype=int))
    assert list(infos["solver_status"]) == ["not_converged"] * 2


@pytest.mark.parametrize(
    ("integrator", "plant"),
    [
        *product(APPROXIMATE, registered_plants(damping=0.3)),
        *pairs(OF_ENGINES, registered_plants(damping=0.3), strength=1),
    ],
)
def test_ledger(integrator, plant):
    check_ledger(integrator, plant)


@pytest.mark.parametrize(
    ("integrator", "defect"),
    [
        ("symplectic_euler", "1.058"),
        ("stormer_verlet", "0.117"),
        ("implicit_midpoint", "1.64e-3"),
    ],
)
def test_polar_coordinates_spoil_canonicity(integrator, defect):
    """The elastic pendulum passes in Cartesian coordinates and fails in polar ones."""
    polar = symplecticity_defect(integrator, PolarElasticPendulum(), POLAR_STATE, 0.05)
    assert polar == stated(defect)
    cartesian = symplecticity_defect(integrator, ElasticPendulum(), (0.3, 0.5, 0.1, 2.0), 0.02)
    assert cartesian < 1e-11


TABLEAUX = [name for name in MAPS.names() if hasattr(MAPS.load(name), "tableau")]


def _trees(order: int) -> set[tuple]:
    """Rooted trees with that many nodes: each a sorted tuple of the trees on its root."""
    if order == 1:
        return {()}
    grown = set()
    for tree in _trees(order - 1):
        grown |= set(_with_a_leaf(tree))
    return grown


def _with_a_leaf(tree: tuple) -> list[tuple]:
    """The tree with one more node, at every place."""
    grown = [tuple(sorted((*tree, ())))]
    for k, branch in enumerate(tree):
        rest = (*tree[:k], *tree[k + 1 :])
        grown += [tuple(sorted((*rest, new))) for new in _with_a_leaf(branch)]
    return grown


def _weights_of(tree: tuple, a: np.ndarray) -> np.ndarray:
    """Elementary weight of the tree in each stage."""
    product = np.ones(len(a))
    for branch in tree:
        product = product * (a @ _weights_of(branch, a))
    return product


def _density(tree: tuple) -> tuple[int, float]:
    """(number of nodes, γ) of the tree."""
    parts = [_density(branch) for branch in tree]
    nodes = 1 + sum(n for n, _ in parts)
    return nodes, nodes * float(np.prod([g for _, g in parts]))


def _defects(tableau: Tableau, order: int) -> list[float]:
    """By how much each condition of that order fails: Hairer, Nørsett and Wanner, I, II.2.11."""
    stages = len(tableau.weights)
    a = np.array([(*row, *[0.0] * (stages - len(row))) for row in tableau.stages])
    b = np.array(tableau.weights)
    return [abs(b @ _weights_of(tree, a) - 1.0 / _density(tree)[1]) for tree in _trees(order)]


@pytest.mark.parametrize("name", TABLEAUX)
def test_a_tableau_is_of_its_order_and_of_no_higher(name):
    owner = MAPS.load(name)
    for order in range(1, owner.order + 1):
        assert max(_defects(owner.tableau, order)) < 1e-14
    assert max(_defects(owner.tableau, owner.order + 1)) > 1e-5


OF_ONE_END = [n for n in map_names() if getattr(one_step_map(n), "losses_of", None)]


@pytest.mark.parametrize("name", OF_ONE_END)
def test_losses_are_of_the_end_that_is_named(name):
    known, dt, rng = one_step_map(name), 0.02, np.random.default_rng(5)
    system = PlantSystem(CartPole(mass=0.5, damping=0.05, cart_damping=0.4))
    for _ in range(20):
        q, v = tuple(rng.uniform(-3.0, 3.0, 2).tolist()), tuple(rng.uniform(-6.0, 6.0, 2).tolist())
        step = known.step(SCALAR, system, q, v, (0.3,), (0.7,), dt)
        state = {"start": (q, v), "end": (step.q, step.v)}[known.losses_of]
        expected = 0.3 + dt * system.plant.dissipation(SCALAR, *state)
        assert step.losses[0] == pytest.approx(expected, rel=1e-14)


OF_BOTH_ENDS = [n for n in map_names() if hasattr(one_step_map(n), "losses_between")]


class _RoughTrack(CartPole):
    """Damped the more, the further out it is."""

    def dissipation(self, ops, q, v):
        return (1.0 + q[0] * q[0]) * super().dissipation(ops, q, v)


@pytest.mark.parametrize(("name", "dt"), pairs(OF_BOTH_ENDS, (1e-4, 0.02, 0.1), strength=1))
def test_losses_follow_from_both_ends(name, dt):
    known, rng = one_step_map(name), np.random.default_rng(5)
    system = PlantSystem(_RoughTrack(mass=0.5, damping=0.05, cart_damping=0.4))
    for _ in range(20):
        q, v = tuple(rng.uniform(-3.0, 3.0, 2).tolist()), tuple(rng.uniform(-6.0, 6.0, 2).tolist())
        step = known.step(SCALAR, system, q, v, (0.3,), (0.7,), dt)
        ends = (q, v), (step.q, step.v)
        (found,) = known.losses_between(SCALAR, system, *ends, (0.3,), (0.7,), dt)
        assert found - 0.3 == pytest.approx(step.losses[0] - 0.3, rel=1e-8)
