"""PyBullet: what would falsify its steps is off, and it leaves the process as it was."""

from __future__ import annotations

import gc

import numpy as np
import pytest
from engine_cases import needs, one_step
from engine_checks import defect, new_setup, told_by_an_episode

from integ_gym.envs.engines.simulator import load_undisturbed

ENGINE = ("pybullet", "semi_implicit_euler")
STOPPED = {"env_id": "IntegCartPoleSwingUp-v0", "contact": "engine", "dt": 0.001}


def _setup(env_id="IntegPendulum-v0", **arguments):
    return new_setup(*ENGINE, env_id, **arguments)


@pytest.fixture
def bullet():
    needs("pybullet")
    return load_undisturbed("pybullet", "pybullet")


def test_the_stop_is_bullets_own_law(bullet):
    """It pushes a penetration out at the rate of its error reduction parameter."""
    setup = _setup(**STOPPED, gravity=0.0)
    erp = setup.engine.describe()["stops"]["erp"]
    x_dot = one_step(setup, (2.41, 0.0), (0.5, 0.0), 0.0)[2]
    assert x_dot == pytest.approx(-erp * 0.01 / 0.001, rel=1e-9)


def test_a_state_that_is_astray_leaves_no_trace(bullet):
    setup = _setup(damping=0.3)
    case = ((1.0,), (2.0,), 0.5)
    before = one_step(setup, *case)
    for values in ((np.nan, 0.0, 0.0), (0.0, np.inf, 0.0), (0.0, 0.0, 1e300), (1e30, 1e30, 0.0)):
        setup.engine.run(3)(*values)
        assert (one_step(setup, *case) == before).all()


def test_engines_in_one_process_do_not_disturb_each_other(bullet):
    slow, quick = _setup(dt=0.05, gravity=1.0), _setup(dt=0.001, gravity=20.0)
    case = ((1.0,), (2.0,), 0.5)
    apart = one_step(slow, *case), one_step(quick, *case)
    assert defect(slow, [case]) < 1e-12 > defect(quick, [case])
    for _ in range(3):
        assert (one_step(quick, *case) == apart[1]).all()
        assert (one_step(slow, *case) == apart[0]).all()


def test_a_client_is_closed_with_its_engine(bullet):
    setup = _setup()
    client = setup.engine._client
    assert bullet.isConnected(client)
    del setup
    gc.collect()
    assert not bullet.isConnected(client)


def test_where_no_client_is_left_the_remedy_is_told(bullet, monkeypatch):
    def refused(_):
        raise bullet.error("Exceeding maximum number of physics connections.")

    monkeypatch.setattr(bullet, "connect", refused)
    with pytest.raises(RuntimeError, match=r"maximum number of physics connections.*Delete"):
        _setup()


def test_nothing_is_printed_and_nothing_written(bullet, tmp_path):
    assert told_by_an_episode(*ENGINE, tmp_path) == (0, "")
