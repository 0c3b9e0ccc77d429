"""SAPIEN: what would falsify its steps is off, and its settings are not those of the process."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import TOLERANCE, needs, one_step
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
def test_a_state_that_is_astray_leaves_no_trace(sapien, integrator):
    setup = _setup(integrator, damping=0.3)
    case = ((1.0,), (2.0,), 0.5)
    before = one_step(setup, *case)
    for values in ((np.nan, 0.0, 0.0), (0.0, np.inf, 0.0), (0.0, 0.0, 1e38), (1e30, 1e30, 0.0)):
        setup.engine.run(3)(*values)
        assert (one_step(setup, *case) == before).all()


def test_nothing_is_printed_and_nothing_written(sapien, tmp_path):
    assert told_by_an_episode("sapien", "tgs", tmp_path) == (0, "")
