"""SAPIEN: what would falsify its steps is off, and its settings are not those of the process."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import DAMPING, IDS, TOLERANCE, needs, one_step, setup_of, states
from engine_checks import defect, new_setup, told_by_an_episode

from integ_gym.envs.engines import sapien as _sapien
from integ_gym.envs.engines.simulator import load_undisturbed
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import ENGINES, MAPS

INTEGRATORS = tuple(ENGINES.load("sapien").maps)
SINGLE = TOLERANCE[32]
STRONGLY_DAMPED = {
    "cart_mass": 0.1, "mass": 10.0, "damping": 500.0, "cart_damping": 500.0, "dt": 0.05,
}  # fmt: skip

each_integrator = pytest.mark.parametrize("integrator", INTEGRATORS)


def _setup(integrator="tgs", env_id="IntegPendulum-v0", **arguments):
    return new_setup("sapien", integrator, env_id, **arguments)


def _configuration(physx):
    config = physx.get_scene_config()
    return [np.asarray(getattr(config, n)).tolist() for n in dir(config) if not n.startswith("_")]


@pytest.fixture
def sapien():
    needs("sapien")
    return load_undisturbed("sapien", "sapien")


@each_integrator
@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("speed", [9.0, 11.0, 49.0, 51.0, 99.0, 101.0, 500.0, 999.0])
def test_no_speed_is_clipped_below_divergence(sapien, integrator, env_id, speed):
    setup = setup_of("sapien", integrator, env_id, **DAMPING[env_id])
    fast = [(q, tuple(speed * np.sign(v)), u) for q, v, u in states(setup)]
    assert defect(setup, fast) < SINGLE


def test_what_sapien_adds_by_itself_would_act(sapien, monkeypatch):
    """Damping and limits of speed of each link, friction and a limit of speed of each joint."""
    monkeypatch.setattr(_sapien, "_release", lambda _: None)
    with pytest.raises(ValueError, match="another mass matrix"):
        _setup()
    monkeypatch.setattr(ENGINES.load("sapien"), "_check", lambda _: None)
    world = _setup().engine._world
    articulation = world.articulation
    link, joint = articulation.links[-1], articulation.active_joints[0]
    assert (link.linear_damping, link.angular_damping) == pytest.approx((0.05, 0.05))
    assert (link.max_linear_velocity, link.max_angular_velocity) == (10.0, 50.0)
    assert (joint.friction, joint.max_velocity) == pytest.approx((0.05, 100.0))


@each_integrator
def test_a_pendulum_near_rest_does_not_fall_asleep(sapien, integrator):
    """Its energy stays below PhysX's own threshold for much longer than PhysX waits."""
    setup = _setup(integrator, dt=0.01, control_period=0.5)
    asked = sapien.physx.get_body_config().sleep_threshold
    start = setup.engine.advance(SCALAR, (np.pi,), (0.01,), ((0.0, 400),), None)
    assert setup.plant.energy(SCALAR, start.q, start.v) < 0.1 * asked
    pushed = one_step(setup, start.q, start.v, 1e-3)
    assert pushed[1] - one_step(setup, start.q, start.v, 0.0)[1] == pytest.approx(3e-5, rel=1e-2)
    there = setup.engine.run(50)(*start.q, *start.v, 0.0)
    assert abs(there[0] - start.q[0]) > 1e-3


@each_integrator
def test_the_solver_has_the_iterations_that_are_told(sapien, integrator):
    engine = _setup(integrator).engine
    told, articulation = engine.describe(), engine._world.articulation
    assert told["position_iterations"] == articulation.solver_position_iterations
    assert told["velocity_iterations"] == articulation.solver_velocity_iterations


def test_the_temporal_solver_has_those_of_sapien_and_damps_in_as_many_parts(sapien):
    told = _setup().engine.describe()
    config = sapien.physx.PhysxBodyConfig()
    assert told["position_iterations"] == MAPS.load(told["map"]).parts
    assert told["position_iterations"] == config.solver_position_iterations
    assert told["velocity_iterations"] == config.solver_velocity_iterations
    assert sapien.physx.PhysxSceneConfig().enable_tgs


def test_the_temporal_solver_is_its_map_where_damping_is_strong(sapien):
    setup = _setup("tgs", "IntegCartPole-v0", **STRONGLY_DAMPED)
    assert defect(setup, states(setup)) < SINGLE


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


def test_what_the_process_has_configured_stays_and_does_not_act(sapien):
    physx = sapien.physx
    before = physx.get_scene_config()
    expected = one_step(_setup(), (1.0,), (2.0,), 0.5)
    try:
        physx.set_scene_config(gravity=[1.0, 2.0, 3.0], enable_tgs=False, bounce_threshold=7.0)
        theirs = _configuration(physx)
        assert (one_step(_setup(), (1.0,), (2.0,), 0.5) == expected).all()
        assert _configuration(physx) == theirs
    finally:
        physx.set_scene_config(before)


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
def test_a_stop_may_be_anywhere(sapien, integrator):
    setup = _setup(integrator, joint_limit=0.2, contact="engine", damping=0.3)
    inside = ((0.1,), (0.5,), 1.0)
    free = one_step(_setup(integrator, damping=0.3), *inside)
    assert one_step(setup, *inside) == pytest.approx(free, abs=SINGLE)
    assert one_step(setup, (0.19,), (3.0,), 0.0)[0] == pytest.approx(0.2, abs=1e-5)


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
