"""One-step maps beside the integrators: what they say of themselves, over the registry."""

from __future__ import annotations

import numpy as np
import pytest
from pairing import pairs

from integ_gym.envs.engines.maps import Tableau, map_names, one_step_map
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import MAPS

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
