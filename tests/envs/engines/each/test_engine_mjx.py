"""MJX: float64 by itself, one program for all mechanisms, stops that weigh what MuJoCo's do."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import needs, setup_of
from engine_checks import new_setup

from integ_gym.envs.ops.ops import SCALAR

ENGINE = ("mjx", "Euler")
STOPPED = {"env_id": "IntegCartPoleSwingUp-v0", "contact": "engine", "dt": 0.001}


@pytest.fixture
def program():
    """The module of MJX's functions."""
    needs("mjx")
    from integ_gym.envs.engines import mjx_program as _mjx_program

    return _mjx_program


def test_one_program_serves_all_mechanisms_of_the_same_joints(program):
    one = setup_of(*ENGINE, "IntegCartPole-v0").engine
    other = setup_of(*ENGINE, "IntegCartPole-v0", dt=0.1, cart_mass=3.0, length=0.2).engine
    assert one._program is other._program
    assert one._program is not setup_of(*ENGINE, "IntegPendulum-v0").engine._program


def test_jax_is_left_as_it_was(program):
    import jax

    before = {name: jax.config.values[name] for name in jax.config.values}
    setup = new_setup(*ENGINE, "IntegPendulum-v0", dt=0.03)
    setup.engine.run(1)(0.1, 0.2, 0.3)
    assert before == {name: jax.config.values[name] for name in jax.config.values}
    assert jax.numpy.zeros(1).dtype == "float32"


def test_lanes_are_single_environments_to_the_last_bit(program):
    """More of them than one call takes; a lane that is astray is lost alone."""
    engine = setup_of(*ENGINE, "IntegCartPole-v0").engine
    count = 2 * program.LANES + 3
    starts = np.random.default_rng(1).uniform(-3.0, 3.0, (6, count))
    starts[1, 5], starts[2, 7] = np.nan, 1e30
    q, v, force = tuple(starts[:2]), tuple(starts[2:4]), tuple(starts[4:])
    many = engine.travel(None, q, v, force, 2)
    for lane in (0, 4, 5, 6, 7, 8, count - 1):
        single = engine.run(2)(*starts[:, lane])
        got = [x[lane] for x in (*many[0], *many[1])]
        assert np.isnan(got).all() if lane in (5, 7) else got == list(single)


@pytest.mark.parametrize("cart_mass", [0.5, 5.0])
def test_its_stops_are_those_of_mujoco(program, cart_mass):
    """Also where the mechanism is another than the one that a program is made for."""
    needs("mujoco")
    told = []
    for engine in ("mjx", "mujoco"):
        setup = new_setup(engine, "Euler", **STOPPED, cart_mass=cart_mass)
        q, v, force = (2.41, 0.3), (1.0, 0.5), (0.0, 0.0)
        end = setup.engine.travel(SCALAR, q, v, force, 1)
        told.append((np.array([*end[0], *end[1]]), setup.engine.describe()["stops"]))
    np.testing.assert_allclose(told[0][0], told[1][0], rtol=1e-9)
    assert told[0][1] == told[1][1]
