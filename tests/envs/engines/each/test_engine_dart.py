"""DART: forces that no limit clamps, nothing that acts beside the mechanism, no memory."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import DAMPING, IDS, mapped, needs, one_step, setup_of, states

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
