"""DART: forces that no limit clamps, nothing that acts beside the mechanism, no memory."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import DAMPING, IDS, mapped, needs, one_step, setup_of, states
from engine_checks import told_by_an_episode

from integ_gym.envs.engines.maps import one_step_map

ENGINE = ("dart", "semi_implicit_euler")

SWING_UP = "IntegCartPoleSwingUp-v0"


@pytest.fixture(autouse=True)
def _installed():
    needs("dart")


@pytest.mark.parametrize("env_id", IDS)
def test_no_cap_on_speed_and_no_hidden_damping(env_id):
    setup = setup_of(*ENGINE, env_id, **DAMPING[env_id])
    known, n = one_step_map(setup.engine.map), len(setup.plant.coordinates)
    for speed in (500.0, -900.0, 1e-7):
        case = ((0.3,) * n, (speed,) * n, 0.7)
        expected = mapped(known, setup, *case)
        np.testing.assert_allclose(one_step(setup, *case), expected, rtol=1e-9, atol=0)


def test_set_forces_is_not_clamped_and_set_commands_is():
    setup = setup_of(*ENGINE, "IntegPendulum-v0", dt=0.011)
    skeleton, world = setup.engine._skeleton, setup.engine._world
    skeleton.getJoint(0).setForceUpperLimit(0, 1.0)
    expected = mapped(one_step_map(setup.engine.map), setup, (0.0,), (0.0,), 3.0)
    np.testing.assert_allclose(one_step(setup, (0.0,), (0.0,), 3.0), expected, rtol=1e-12)
    skeleton.setPosition(0, 0.0)
    skeleton.setVelocity(0, 0.0)
    skeleton.setForce(0, 0.0)
    skeleton.setCommand(0, 3.0)
    world.step()
    assert skeleton.getVelocity(0) == pytest.approx(expected[1] / 3.0, rel=1e-9)


def test_resting_bodies_are_not_put_to_sleep():
    setup = setup_of(*ENGINE, SWING_UP, contact="engine")
    assert not setup.engine._world.getDeactivationOptions().mEnabled


def test_a_stop_leaves_no_memory():
    """To the last bit, steps into, at and away from the stop in any order."""
    setup = setup_of(*ENGINE, SWING_UP, contact="engine")
    rng = np.random.default_rng(2)
    cases = [((2.4 + 0.1 * q[0] / 3.0, q[1]), v, u) for q, v, u in states(setup, 20)]
    alone = [one_step(setup, *case) for case in cases]
    for k in rng.integers(0, 20, 100):
        assert (one_step(setup, *cases[k]) == alone[k]).all()


def test_stops_are_recorded_with_what_they_are_made_of():
    setup = setup_of(*ENGINE, SWING_UP, contact="engine")
    assert setup.engine.describe()["stops"] == {
        "error_allowance": 0.0,
        "error_reduction_parameter": 0.01,
        "max_error_reduction_velocity": 10.0,
        "constraint_force_mixing": 1e-9,
    }


def test_what_is_astray_is_not_hidden(capfd):
    """DART would warn, and go on without accelerations that are not finite."""
    setup = setup_of(*ENGINE, "IntegCartPole-v0")
    run = setup.engine.run(3)
    for value in (np.nan, np.inf, 1e300):
        for place in range(6):
            values = [0.1] * 6
            values[place] = value
            assert np.isnan(run(*values)).all()
    assert capfd.readouterr() == ("", "")


def test_an_episode_leaves_the_process_as_it_was(tmp_path):
    assert told_by_an_episode(*ENGINE, tmp_path) == (0, "")
