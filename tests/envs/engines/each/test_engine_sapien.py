"""SAPIEN: what would falsify its steps is off, and its settings are not those of the process."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import IDS, TOLERANCE, needs, one_step, states
from engine_checks import defect, new_setup, told_by_an_episode

from integ_gym.envs.engines.simulator import load_undisturbed
from integ_gym.envs.registries import ENGINES

INTEGRATORS = tuple(ENGINES.load("sapien").maps)
SINGLE = TOLERANCE[32]
STRONGLY_DAMPED = {
    "cart_mass": 0.1, "mass": 10.0, "damping": 500.0, "cart_damping": 500.0, "dt": 0.05,
}  # fmt: skip

each_integrator = pytest.mark.parametrize("integrator", INTEGRATORS)


def _setup(integrator="tgs", env_id="IntegPendulum-v0", **arguments):
    return new_setup("sapien", integrator, env_id, **arguments)


@pytest.fixture
def sapien():
    needs("sapien")
    return load_undisturbed("sapien", "sapien")


def test_damping_that_the_projected_solver_does_not_resolve_is_refused(sapien):
    with pytest.raises(ValueError, match=r"does not resolve in 50 iterations.*'tgs'"):
        _setup("pgs", "IntegCartPole-v0", **STRONGLY_DAMPED, mass_distribution="point")


@each_integrator
@pytest.mark.parametrize("env_id", IDS)
def test_a_point_mass_is_one(sapien, integrator, env_id):
    setup = _setup(integrator, env_id, mass_distribution="point", mass=0.01, length=0.02)
    assert defect(setup, states(setup)) < SINGLE


@each_integrator
def test_engines_in_one_process_do_not_disturb_each_other(sapien, integrator):
    other = INTEGRATORS[1 - INTEGRATORS.index(integrator)]
    slow = _setup(integrator, dt=0.05, gravity=1.0, damping=0.3)
    quick = _setup(other, dt=0.001, gravity=20.0, damping=0.1)
    case = ((1.0,), (2.0,), 0.5)
    apart = one_step(slow, *case), one_step(quick, *case)
    assert defect(slow, [case]) < SINGLE > defect(quick, [case])
    for _ in range(3):
        assert (one_step(quick, *case) == apart[1]).all()
        assert (one_step(slow, *case) == apart[0]).all()


@each_integrator
def test_a_cart_stays_at_the_stop_whatever_went_before(sapien, integrator):
    arguments = {"contact": "engine", "dt": 0.001}
    setup = _setup(integrator, "IntegCartPoleSwingUp-v0", **arguments)
    cases = [((x, 0.3), (1.0, 0.0), 0.0) for x in (2.4, 0.0, 2.41, -2.41, 2.3995)]
    alone = [
        one_step(_setup(integrator, "IntegCartPoleSwingUp-v0", **arguments), *case).tolist()
        for case in cases
    ]
    assert [one_step(setup, *case).tolist() for case in cases] == alone
    assert max(abs(end[0]) for end in alone) < 2.4 + 1e-5
    assert setup.engine.describe()["stops"]["solver"] == integrator


@each_integrator
def test_a_state_that_is_astray_leaves_no_trace(sapien, integrator):
    setup = _setup(integrator, damping=0.3)
    case = ((1.0,), (2.0,), 0.5)
    before = one_step(setup, *case)
    for values in ((np.nan, 0.0, 0.0), (0.0, np.inf, 0.0), (0.0, 0.0, 1e38), (1e30, 1e30, 0.0)):
        setup.engine.run(3)(*values)
        assert (one_step(setup, *case) == before).all()


@each_integrator
def test_nothing_is_printed_and_nothing_written(sapien, tmp_path, integrator):
    assert told_by_an_episode("sapien", integrator, tmp_path) == (0, "")
