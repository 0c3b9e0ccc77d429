"""The quadrotor in engines: thrusts that turn with the body, and lag behind their commands."""

from __future__ import annotations

import re

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import (
    EVERY,
    FIRST,
    TOLERANCE,
    assert_accelerations,
    lighter,
    native_name,
    needs,
    setup_of,
)
from functional_checks import compare

import integ_gym  # noqa: F401
from integ_gym.envs.engines.maps import map_names, one_step_map
from integ_gym.envs.engines.rigid import EXPLICIT_FORCES, RigidBodyEngine
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import ENGINES
from integ_gym.envs.settings import Setup

QUADROTOR = "IntegQuadrotor-v0"
VARIANTS = {
    "lag": {},
    "no lag": {"motor_time_constant": None},
    "way-points": {"way_point_period": 2.0},
    "no drag": {"damping": 0.0},
}
THRUSTS = (4.0, 1.5)
HOLDING = [case for case in EVERY if issubclass(ENGINES.load(case[0]), RigidBodyEngine)]
"""Engines that take generalized forces once in a step; the others evaluate them in each stage."""
REFUSED = [case for case in HOLDING if ENGINES.load(case[0]).maps[case[1]] not in EXPLICIT_FORCES]
TAKES = [case for case in EVERY if case not in REFUSED]


def _setup(engine: str, integrator: str, variant: str) -> Setup:
    return setup_of(engine, integrator, QUADROTOR, **VARIANTS[variant])


def _states(setup: Setup) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """(q, v) anywhere in the room, tilted and turning, the thrusts within their limits."""
    rng, n = np.random.default_rng(3), len(setup.plant.coordinates)
    return [
        (
            tuple(rng.uniform(-3.0, 3.0, n).tolist()),
            (*rng.uniform(-5.0, 5.0, 3).tolist(), *rng.uniform(0.0, 6.0, n - 3).tolist()),
        )
        for _ in range(8)
    ]


def _allowed(setup: Setup, q: tuple[float, ...]) -> float:
    """The tolerance of the other plants; of Newton's Featherstone, which refers to the origin.

    There the body's inertia is found as a difference of moments about the world's origin, so that
    32 bits lose as many as those moments are larger.
    """
    plain = TOLERANCE[setup.engine.width]
    if setup.settings.integrator != "featherstone":
        return plain
    plant = setup.plant
    return max(plain, 4.0 * 2.0**-24 * plant.mass * (q[0] ** 2 + q[1] ** 2) / plant.inertia)


def _error(setup: Setup, name: str, q: tuple[float, ...], v: tuple[float, ...]) -> float:
    """Largest of one step against a map, relative to 1 + |value|."""
    known, system, dt = one_step_map(name), setup.system, setup.timing.dt
    end = known.step(SCALAR, system, q, v, system.no_losses, THRUSTS, dt)
    motion = setup.engine.advance(SCALAR, q, v, ((THRUSTS, 1),), None)
    expected, got = np.array((*end.q, *end.v)), np.array((*motion.q, *motion.v))
    return float((np.abs(got - expected) / (1.0 + np.abs(expected))).max())


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(("engine", "integrator"), lighter(TAKES))
def test_a_flight_is_the_map_that_an_engine_is_said_to_apply(engine, integrator, variant):
    setup = _setup(engine, integrator, variant)
    for q, v in _states(setup):
        assert _error(setup, setup.engine.map, q, v) <= _allowed(setup, q)


@pytest.mark.parametrize(("engine", "integrator"), lighter(TAKES))
def test_no_other_map_would_do(engine, integrator):
    """With so much drag that maps which take it otherwise differ."""
    setup = setup_of(engine, integrator, QUADROTOR, damping=2.0)
    q, v = _states(setup)[0]
    for name in {*map_names()} - {setup.engine.map}:
        assert _error(setup, name, q, v) > 10.0 * _allowed(setup, q), name


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(("engine", "integrator"), lighter(REFUSED))
def test_maps_that_take_forces_within_a_step_are_refused(engine, integrator, variant):
    """With the integrators of the engine that do not."""
    needs(engine)
    choices = [x for x, y in ENGINES.load(engine).maps.items() if y in EXPLICIT_FORCES]
    said = f"under integrator '{integrator}'; use `integrator`: {', '.join(choices)}, or engine"
    with pytest.raises(ValueError, match=re.escape(said)):
        _setup(engine, integrator, variant)


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
@pytest.mark.parametrize("variant", ["lag", "way-points"])
def test_an_episode_is_that_of_the_map_on_the_native_engine(engine, integrator, variant):
    """Latency, samples and saturation included; observations, rewards and ledgers agree."""
    needs(engine)
    own = ENGINES.load(engine)
    given = {
        "dt": 0.005, "control_period": 0.02, "action_latency": 0.005, "sensor_period": 0.015,
        **VARIANTS[variant],
    }  # fmt: skip
    there = gym.make(QUADROTOR, engine=engine, integrator=integrator, **given)
    here = gym.make(QUADROTOR, integrator=native_name(own.maps[integrator]), **given)
    near = 1e-9 if own.width == 64 else 2e-4
    (a, _), (b, _) = there.reset(seed=3), here.reset(seed=3)
    for k in range(25):
        np.testing.assert_allclose(a, b, rtol=0, atol=max(near, 1e-6))
        action = np.float32([3.2 + 2.0 * np.sin(k), 3.2 - 3.5 * np.sin(k)])
        a, reward, *_, info = there.step(action)
        b, expected, *_, known = here.step(action)
        assert reward == pytest.approx(expected, abs=near)
        for name in ("energy", "actuator_work", "dissipated", "energy_residual"):
            assert info[name] == pytest.approx(known[name], abs=10.0 * near), name
    assert abs(info["actuator_work"]) > 0.01 < abs(info["energy"])


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_lanes_and_single_environments_agree(engine, integrator):
    needs(engine)
    given = {"engine": engine, "integrator": integrator, "dt": 0.01, "control_period": 0.02}
    many = gym.make_vec(QUADROTOR, num_envs=3, **given)
    singles = [gym.make(QUADROTOR, **given) for _ in range(3)]
    many.reset(seed=11)
    for lane, env in enumerate(singles):
        env.reset(seed=11 + lane)
    for k in range(10):
        actions = np.float32([[3.0 + lane, 4.0 - k / 3.0] for lane in range(3)])
        observation, reward, *_, info = many.step(actions)
        told = [env.step(action) for env, action in zip(singles, actions, strict=True)]
        np.testing.assert_allclose(observation, np.stack([t[0] for t in told]), atol=1e-6)
        np.testing.assert_allclose(reward, [t[1] for t in told], atol=1e-6)
        for name in ("energy", "actuator_work", "energy_residual"):
            np.testing.assert_allclose(info[name], [t[4][name] for t in told], atol=1e-5)


@pytest.mark.slow
def test_mjx_in_jax_equals_its_vector_environment():
    needs("mjx")
    given = {"engine": "mjx", "integrator": "Euler", "dt": 0.01, "control_period": 0.02}
    compare(QUADROTOR, {**given, "action_latency": 0.01, "way_point_period": 1.0})


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_accelerations_before_a_step_are_the_plants(engine, integrator):
    """And the rates of the thrusts."""
    setup = _setup(engine, integrator, "way-points")
    assert_accelerations(setup, _states(setup), THRUSTS)
