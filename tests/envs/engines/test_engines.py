"""Every engine, over the registry: what map it applies, and that it keeps the contract."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import (
    COMPILING,
    DAMPING,
    FIRST,
    FOREIGN,
    IDS,
    TOLERANCE,
    lighter,
    mapped,
    native_name,
    needs,
    one_step,
    setup_of,
    solved,
    sparing,
    states,
)
from engine_checks import defect, new_setup

import integ_gym  # noqa: F401
from integ_gym.envs.engines.maps import map_names, one_step_map
from integ_gym.envs.mechanics import Mechanism
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.registries import ENGINES
from integ_gym.envs.steps import trace_function
from integ_gym.envs.transition import EnvState, initial_state, scalar_step, transition


@pytest.mark.parametrize(
    ("engine", "integrator", "env_id", "damped"), sparing(IDS[::-1], (True, False))
)
def test_an_engine_applies_the_map_that_it_is_said_to(engine, integrator, env_id, damped):
    """Each integrator with both plants, damped and undamped."""
    setup = setup_of(engine, integrator, env_id, **(DAMPING[env_id] if damped else {}))
    known = one_step_map(setup.engine.map)
    tolerance = TOLERANCE[setup.engine.width]
    for q, v, control in (*states(setup, 10), *states(setup, 5, strongest=0.0)):
        expected = mapped(known, setup, q, v, control)
        error = np.abs(one_step(setup, q, v, control) - expected) / (1.0 + np.abs(expected))
        assert error.max() <= tolerance


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_no_speed_is_clipped_below_divergence(engine, integrator):
    """Nor does an engine damp by itself, in short steps in which every implicit one is solved."""
    setup = setup_of(engine, integrator, "IntegPendulum-v0", dt=1e-4, damping=0.3)
    tolerance = 10.0 * TOLERANCE[setup.engine.width]
    for speed in (11.0, -101.0, 999.0):
        expected = mapped(one_step_map(setup.engine.map), setup, (0.3,), (speed,), 0.7)
        np.testing.assert_allclose(one_step(setup, (0.3,), (speed,), 0.7), expected, rtol=tolerance)


@pytest.mark.parametrize(("engine", "integrator", "env_id"), sparing(IDS[::-1], strength=1))
def test_no_other_map_would_do(engine, integrator, env_id):
    """With damping and control, every map but the declared one is further away."""
    setup = setup_of(engine, integrator, env_id, dt=0.1, **DAMPING[env_id])
    own, cases = setup.engine.map, solved(setup, states(setup, 16))[:4]
    assert len(cases) == 4
    gaps = {}
    for name in {own, *map_names()}:
        known = one_step_map(name)
        gaps[name] = max(
            np.abs(one_step(setup, *state) - mapped(known, setup, *state)).max() for state in cases
        )
    others = {name: gap for name, gap in gaps.items() if name != own}
    same = {name for name, gap in others.items() if gap <= TOLERANCE[setup.engine.width]}
    assert gaps[own] == min(gaps.values()) or gaps[own] <= TOLERANCE[setup.engine.width]
    assert same <= _EQUAL_ON_THE_PENDULUM if env_id == "IntegPendulum-v0" else not same


_EQUAL_ON_THE_PENDULUM = {
    "symplectic_euler_implicit_damping",
    "symplectic_euler_implicit_velocity",
}
"""Damping is the pendulum's only force that depends on the velocity."""


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_an_episode_is_that_of_the_map_on_the_native_engine(engine, integrator):
    """Latency, sampling, noise and damping included; returns, ledgers and observations agree."""
    needs(engine)
    own = ENGINES.load(engine)
    arguments = {
        "dt": 0.01, "control_period": 0.05, "damping": 0.2, "action_latency": 0.02,
        "sensor_period": 0.02, "observation_noise": 0.01, "duration": 1.0,
    }  # fmt: skip
    there = gym.make("IntegPendulum-v0", engine=engine, integrator=integrator, **arguments)
    here = gym.make("IntegPendulum-v0", integrator=native_name(own.maps[integrator]), **arguments)
    tolerance = 1e-6 if own.width == 64 else 2e-3
    rng = np.random.default_rng(0)
    a, _ = there.reset(seed=3)
    b, _ = here.reset(seed=3)
    for _ in range(20):
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance)
        action = rng.uniform(-2.0, 2.0, 1).astype(np.float32)
        a, reward, *_, info = there.step(action)
        b, expected, *_, known = here.step(action)
        assert reward == pytest.approx(expected, abs=tolerance * 100)
        for name in ("energy", "actuator_work", "dissipated", "energy_residual"):
            assert info[name] == pytest.approx(known[name], abs=tolerance * 100), name
        assert info["solver_status"] == ("ok" if own.reports else "not_reported")


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_a_step_depends_on_nothing_that_went_before_and_several_are_single_ones(engine, integrator):
    setup = setup_of(engine, integrator, "IntegCartPole-v0")
    (first, *others) = states(setup, 4)
    alone = one_step(setup, *first)
    for state in others:
        one_step(setup, *state)
    assert (one_step(setup, *first) == alone).all()
    q, v, control = first
    at_once = setup.engine.advance(SCALAR, q, v, (((control,), 5),), None)
    for _ in range(5):
        motion = setup.engine.advance(SCALAR, q, v, (((control,), 1),), None)
        q, v = motion.q, motion.v
    tolerance = 1e-12 if setup.engine.width == 64 else 1e-4
    np.testing.assert_allclose((*at_once.q, *at_once.v), (*q, *v), rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    ("engine", "integrator"),
    [x for x in (*FIRST, ("sapien", "pgs")) if x[0] not in COMPILING],
)
def test_engines_in_one_process_do_not_disturb_each_other(engine, integrator):
    """And a state that is astray leaves no trace."""
    needs(engine)
    slow = new_setup(engine, integrator, "IntegPendulum-v0", dt=0.05, gravity=1.0, damping=0.3)
    quick = new_setup(engine, integrator, "IntegPendulum-v0", dt=0.001, gravity=20.0)
    case, tolerance = ((1.0,), (2.0,), 0.5), TOLERANCE[slow.engine.width]
    apart = one_step(slow, *case), one_step(quick, *case)
    assert defect(slow, [case]) < tolerance > defect(quick, [case])
    for values in ((np.nan, 0.0, 0.0), (0.0, np.inf, 0.0), (0.0, 0.0, 1e38), (1e30, 1e30, 0.0)):
        if hasattr(slow.engine, "run"):
            slow.engine.run(3)(*values)
        assert (one_step(quick, *case) == apart[1]).all()
        assert (one_step(slow, *case) == apart[0]).all()


@pytest.mark.parametrize(
    ("engine", "integrator"),
    lighter(
        [*FIRST, ("mujoco", "implicit"), ("drake", "radau3"), ("drake", "semi_explicit_euler")]
    ),
)
@pytest.mark.parametrize("env_id", IDS)
def test_damping_is_booked_in_one_call_as_step_by_step(engine, integrator, env_id):
    """A sensor that samples each step has them taken singly; latency makes calls of 3 and 4."""
    given = {"dt": 0.01, "control_period": 0.07, "action_latency": 0.03, **DAMPING[env_id]}
    at_once = setup_of(engine, integrator, env_id, **given)
    singly = setup_of(engine, integrator, env_id, sensor_period=0.01, **given)
    tolerance = 1e-12 if at_once.engine.width == 64 else 1e-4
    q, v, _ = states(at_once, 1)[0]
    here, there = (initial_state(SCALAR, setup, q, v) for setup in (at_once, singly))
    for action in (1.0, 0.0, 0.0, 1.0):
        here, told = transition(SCALAR, at_once, here, (action,))
        there, expected = transition(SCALAR, singly, there, (action,))
        assert told.dissipated > 0.0
        assert told.dissipated == pytest.approx(expected.dissipated, rel=tolerance)
        assert (*here.q, *here.v) == pytest.approx((*there.q, *there.v), rel=tolerance)
        assert told.iterations == expected.iterations


@pytest.mark.parametrize("damped", [False, True], ids=["undamped", "damped"])
@pytest.mark.parametrize(("engine", "integrator"), lighter([*FIRST, ("mujoco", "implicit")]))
def test_a_divergence_within_a_control_period_is_seen_by_one_call_too(engine, integrator, damped):
    """Fast starts, some of which go beyond the speed of divergence and come back."""
    damping = {"damping": 1e-4, "cart_damping": 0.01} if damped else {}
    given = {"dt": 0.02, "control_period": 0.4, **damping}
    at_once = setup_of(engine, integrator, "IntegCartPole-v0", **given)
    singly = setup_of(engine, integrator, "IntegCartPole-v0", sensor_period=0.02, **given)
    rng = np.random.default_rng(0)
    starts = [((0.0, 0.7272801804911515), (230.97361923184525, 274.3261077665781))]
    starts += [((0.0, a), (240.0 * x, 300.0 * y)) for a, x, y in rng.uniform(-1.0, 1.0, (9, 3))]
    for q, v in starts:
        seen = []
        for setup in (at_once, singly):
            _, told = transition(SCALAR, setup, initial_state(SCALAR, setup, q, v), (1.0,))
            seen.append((told.status, told.reward, told.terminated))
        assert seen[0] == seen[1], (q, v)


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_the_vector_environment_equals_the_single_one(engine, integrator):
    needs(engine)
    arguments = {"engine": engine, "integrator": integrator, "dt": 0.02}
    many = gym.make_vec("IntegCartPole-v0", num_envs=3, **arguments)
    singles = [gym.make("IntegCartPole-v0", **arguments) for _ in range(3)]
    observation, _ = many.reset(seed=11)
    alone = [env.reset(seed=11 + lane)[0] for lane, env in enumerate(singles)]
    np.testing.assert_array_equal(observation, np.stack(alone))
    for step in range(10):
        action = step % 2
        observation, reward, *_, info = many.step(np.full(3, action))
        told = [env.step(action) for env in singles]
        np.testing.assert_allclose(observation, np.stack([t[0] for t in told]), atol=1e-6)
        np.testing.assert_allclose(reward, [t[1] for t in told])
        np.testing.assert_allclose(info["energy"], [t[4]["energy"] for t in told], atol=1e-5)
        assert info["solver_status"].tolist() == [t[4]["solver_status"] for t in told]


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_steps_are_traced_to_the_same_bits(engine, integrator):
    setup = setup_of(engine, integrator, "IntegPendulum-v0", control_period=0.06, damping=0.2)
    plain, step = partial(scalar_step, setup, SCALAR), trace_function(setup, scalar_step)
    assert step is not None
    state = initial_state(SCALAR, setup, (0.5,), (3.0,))
    for action in (2.0, -1.0, 0.5):
        expected = plain(state, (action,))
        assert repr(step(state, (action,))) == repr(expected)
        state = EnvState._make(expected[0])


@pytest.mark.parametrize("engine", [e for e in FOREIGN if not ENGINES.load(e).batched])
def test_plant_parameters_that_differ_between_lanes_are_refused(engine):
    needs(engine)
    integrator = next(iter(ENGINES.load(engine).maps))
    with pytest.raises(ValueError, match=f"engine '{engine}' takes one value of `mass`"):
        gym.make_vec(
            "IntegPendulum-v0", num_envs=2, engine=engine, integrator=integrator,
            mass=np.array([1.0, 2.0]),
        )  # fmt: skip


@pytest.mark.parametrize(
    ("engine", "asked", "remedy"),
    [
        *((engine, "leapfrog", ".*Valid choices") for engine in FOREIGN),
        ("drake", "symplectic_euler", "; what applies it is 'tamsi' or 'semi_explicit_euler'"),
        ("mujoco", "rk4", "; what applies it is 'RK4'"),
    ],
)
def test_an_integrator_that_the_engine_lacks_is_refused_with_those_it_has(engine, asked, remedy):
    needs(engine)
    with pytest.raises(ValueError, match=f"has no integrator '{asked}'{remedy}"):
        gym.make("IntegPendulum-v0", engine=engine, integrator=asked)


@pytest.mark.parametrize("engine", [*FOREIGN, "native"])
def test_stops_of_an_engine_that_has_none_are_refused(engine):
    needs(engine)
    owner = ENGINES.load(engine)
    integrator = next(iter(getattr(owner, "maps", {"rk4": ""})))
    if owner.own_stops:
        with pytest.raises(ValueError, match="needs stops"):
            gym.make("IntegPendulum-v0", engine=engine, integrator=integrator, contact="engine")
        return
    with pytest.raises(ValueError, match=r"no joint stops of its own.*use one that has \(\w+"):
        gym.make(
            "IntegPendulum-v0", engine=engine, integrator=integrator, contact="engine",
            joint_limit=1.0,
        )  # fmt: skip


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_a_divergence_ends_the_episode(engine, integrator):
    needs(engine)
    env = gym.make(
        "IntegPendulum-v0", engine=engine, integrator=integrator, dt=0.05, max_torque=1e6,
        length=0.01,
    )  # fmt: skip
    env.reset(seed=0)
    observation, reward, terminated, _, info = env.step([1e6])
    assert terminated
    assert info["solver_status"] == "diverged"
    assert np.isfinite(observation).all()
    assert np.isfinite(reward)


@pytest.mark.parametrize(
    ("engine", "integrator"), lighter([case for case in FIRST if case[0] != "casadi"])
)
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("mass", "another mass matrix"),
        ("damping", "dampers of its `mechanism` take"),
        (None, "1 coordinates with mass and its `mechanism` 2 links"),
    ],
)
def test_a_model_that_is_not_the_plant_is_refused(engine, integrator, wrong, message, monkeypatch):
    """Where the link that engines are told of is not the plant's; CasADi is told none."""
    needs(engine)
    right = Pendulum.mechanism.func

    def changed(plant):
        (link,) = right(plant).links
        links = (link, link)
        if wrong is not None:
            links = (replace(link, **{wrong: 1.01 * getattr(link, wrong)}),)
        return Mechanism(links, right(plant).gravity)

    monkeypatch.setattr(Pendulum, "mechanism", property(changed))
    with pytest.raises(ValueError, match=message):
        gym.make("IntegPendulum-v0", engine=engine, integrator=integrator, dt=0.0123, damping=0.5)
