"""DART, PyBullet and SAPIEN: what would falsify their steps is off, and stops are their own law."""

import gc

import numpy as np
import pytest
from engine_cases import needs, one_step
from engine_checks import new_setup

from integ_gym.envs.engines.simulator import load_undisturbed

STOPPED = {"env_id": "IntegCartPoleSwingUp-v0", "contact": "engine", "dt": 0.001}


def _bullet(env_id="IntegPendulum-v0", **arguments):
    needs("pybullet")
    return new_setup("pybullet", "semi_implicit_euler", env_id, **arguments)


def test_the_stop_is_bullets_own_law():
    """It pushes a penetration out at the rate of its error reduction parameter."""
    setup = _bullet(**STOPPED, gravity=0.0)
    erp = setup.engine.describe()["stops"]["erp"]
    x_dot = one_step(setup, (2.41, 0.0), (0.5, 0.0), 0.0)[2]
    assert x_dot == pytest.approx(-erp * 0.01 / 0.001, rel=1e-9)


def test_a_client_of_bullet_is_closed_with_its_engine_and_where_none_is_left_that_is_told(
    monkeypatch,
):
    setup = _bullet()
    bullet, client = load_undisturbed("pybullet", "pybullet"), setup.engine._client
    assert bullet.isConnected(client)
    del setup
    gc.collect()
    assert not bullet.isConnected(client)

    def refused(_):
        raise bullet.error("Exceeding maximum number of physics connections.")

    monkeypatch.setattr(bullet, "connect", refused)
    with pytest.raises(RuntimeError, match=r"maximum number of physics connections.*Delete"):
        _bullet()


def test_damping_that_sapiens_projected_solver_does_not_resolve_is_refused():
    needs("sapien")
    strong = {"cart_mass": 0.1, "mass": 10.0, "damping": 500.0, "cart_damping": 500.0, "dt": 0.05}
    with pytest.raises(ValueError, match=r"does not resolve in 50 iterations.*'tgs'"):
        new_setup("sapien", "pgs", "IntegCartPole-v0", **strong, mass_distribution="point")


def test_dart_puts_no_body_to_sleep_and_hides_nothing_astray(capfd):
    """DART would warn, and go on without accelerations that are not finite."""
    needs("dart")
    engine = new_setup("dart", "semi_implicit_euler", **STOPPED).engine
    assert not engine._world.getDeactivationOptions().mEnabled
    run = new_setup("dart", "semi_implicit_euler", "IntegCartPole-v0").engine.run(3)
    for value in (np.nan, np.inf, 1e300):
        for place in range(6):
            values = [0.1] * 6
            values[place] = value
            assert np.isnan(run(*values)).all()
    assert capfd.readouterr() == ("", "")
