"""Chains of rods of any number: other plants where they are the same, and what is conserved."""

import numpy as np
import pytest
from plant_checks import check_closed_forms_of

from integ_gym.envs.engines.rigid import joint_masses, probes
from integ_gym.envs.engines.stepping import make_engine
from integ_gym.envs.numerics.stepping import advance, probe_state
from integ_gym.envs.ops.ops import SCALAR, split_state
from integ_gym.envs.plants.chain import Chain, chain_of
from integ_gym.envs.plants.double_pendulum import DoublePendulum
from integ_gym.envs.plants.system import PlantSystem


@pytest.mark.parametrize("links", [1, 2, 5, 10])
def test_a_chain_of_any_number_is_that_of_the_closed_form(links):
    plant = chain_of(links)(mass=1.3, length=0.7, damping=0.2)
    check_closed_forms_of(plant, probe_state(plant), "chain")


def test_two_links_are_the_double_pendulum():
    mass, length = 1.3, 0.7
    same = {"centre": 0.5 * length, "inertia": mass * length**2 / 12.0}
    given = {
        f"{k}_{i}": x for k, x in {"mass": mass, "length": length, **same}.items() for i in (1, 2)
    }
    arm = DoublePendulum(**given, gravity=9.81, damping=0.2)
    chain = chain_of(2)(mass=mass, length=length, damping=0.2)
    q, v, force = (0.4, -1.1), (2.0, -0.7), (0.3, 0.9)
    found, wanted = (p.acceleration(SCALAR, q, v, force) for p in (chain, arm))
    assert found == pytest.approx(wanted, rel=1e-13)
    assert chain.energy(SCALAR, q, v) == pytest.approx(arm.energy(SCALAR, q, v), rel=1e-14)


def test_three_links_are_the_registered_plant_and_less_than_one_is_refused():
    assert chain_of(3) is Chain
    assert chain_of(4) is chain_of(4)
    with pytest.raises(ValueError, match="`links` must be at least 1, got 0"):
        chain_of(0)


@pytest.mark.parametrize("links", [2, 5])
def test_without_gravity_energy_and_angular_momentum_stay(links):
    plant = chain_of(links)(gravity=0.0)
    start = probe_state(plant)

    def invariants(state):
        q, v = split_state(tuple(state.tolist()))
        return plant.energy(SCALAR, q, v), np.dot(plant.mass_matrix(SCALAR, q)[0], v)

    end = advance("reference", plant, start, 0.05, 20)
    assert np.abs(end - start).max() > 0.5
    assert invariants(end) == pytest.approx(invariants(start), rel=1e-11)
    crude = advance("explicit_euler", plant, start, 0.05, 20)
    assert invariants(crude)[0] != pytest.approx(invariants(start)[0], rel=1e-3)


@pytest.mark.parametrize("engine", ["mujoco/RK4", "drake/runge_kutta3"])
def test_an_engine_moves_five_links_to_where_they_go(engine):
    plant = chain_of(5)()
    start = 0.2 * probe_state(plant)
    name, _, own = engine.partition("/")
    assert make_engine(name, PlantSystem(plant), own, 1e-3).name == name
    truth, found = (advance(one, plant, start, 1e-3, 100) for one in ("reference", engine))
    assert np.abs(found - truth).max() < 1e-7


@pytest.mark.parametrize("integrator", ["tgs", "pgs"])
def test_sapien_has_the_masses_of_ten_links_to_rounding(integrator):
    """By impulses in float32, although the mass matrix is close to singular."""
    plant = chain_of(10)()
    engine = make_engine("sapien", PlantSystem(plant), integrator, 1e-3)
    for q in probes(10):
        wanted = joint_masses(plant, q)
        assert np.abs(engine.at_rest(q)[0] - wanted).max() < 1e-6 * wanted.max()
    assert np.linalg.cond(joint_masses(plant, probes(10)[0])) > 1e4
