"""Baseline controllers: what they reach on the truth, and that they are the same everywhere."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

import integ_gym
from integ_gym.train.baselines import BASELINES, EnergyShaping, has_handmade, make_baseline
from integ_gym.train.policy import Policy

pytest.importorskip("scipy")

from integ_gym.train.lqr import held, linearized, lqr_gain

PENDULUM, CART_POLE = "IntegPendulum-v0", "IntegCartPole-v0"
SWING_UP, ELASTIC = "IntegCartPoleSwingUp-v0", "IntegElasticPendulum-v0"
TIGHT = {"integrator": "reference", "dt": 0.05, "start": "hanging"}
EPISODES = 50


class Result(NamedTuple):
    """Of one batch of episodes."""

    success: float
    since: NDArray[np.float64]
    """When the final stay at the goal began, s, of the episodes that succeeded."""
    returns: NDArray[np.float64]
    controls: NDArray[np.float64]
    """Applied, shape (steps, episodes)."""


@dataclass(frozen=True)
class Idle:
    """A task that nobody has a controller for."""


def setup_of(env_id: str, **arguments: Any) -> Any:
    return gym.make(env_id, **arguments).unwrapped.setup  # type: ignore[attr-defined]


def play(env_id: str, name: str, episodes: int = EPISODES, **arguments: Any) -> Result:
    """Evaluate a baseline on one batch of episodes, all of which start anew when they end."""
    envs = gym.make_vec(
        env_id, num_envs=episodes, vectorization_mode="vector_entry_point", **arguments
    )
    setup = envs.unwrapped.setup  # type: ignore[attr-defined]
    policy = make_baseline(name, setup)
    observations, _ = envs.reset(seed=100)
    running = np.ones(episodes, dtype=bool)
    success, since = np.zeros(episodes, dtype=bool), np.zeros(episodes)
    returns, controls = np.zeros(episodes), []
    for _ in range(setup.timing.horizon):
        observations, rewards, terminated, truncated, info = envs.step(policy.act(observations))
        returns += np.where(running, rewards, 0.0)
        controls.append(info["control"])
        ended = running & (terminated | truncated)
        success[ended], since[ended] = info["success"][ended], info["goal_since"][ended]
        running &= ~ended
        if not running.any():
            break
    return Result(float(success.mean()), since[success], returns, np.array(controls))


# --- the protocol -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", BASELINES)
@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_protocol(env_id: str, name: str) -> None:
    env = gym.make(env_id)
    policy = make_baseline(name, env.unwrapped.setup)  # type: ignore[attr-defined]
    assert isinstance(policy, Policy)
    assert policy.policy_id == name
    assert len(policy.content_hash) == 64
    assert env.observation_space.shape is not None
    size = env.observation_space.shape[0]
    observations = np.random.default_rng(0).normal(size=(6, size)).astype(np.float32)
    actions = policy.act(observations)
    assert policy.act(observations[:0]).shape[0] == 0
    if env_id != CART_POLE:
        assert actions.dtype == np.float32
        assert actions.shape == (6, 1)
        assert all(action in env.action_space for action in actions)
    elif name != "zero":
        assert actions.dtype == np.int64
        assert actions.shape == (6,)
        assert all(action in env.action_space for action in actions)


@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_which_tasks_have_a_hand_made_controller(env_id: str) -> None:
    setup = setup_of(env_id)
    assert has_handmade(setup)
    other = replace(setup, task=Idle())
    assert not has_handmade(other)
    with pytest.raises(ValueError, match="there is no hand-made controller for the task Idle"):
        make_baseline("handmade", other)


@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_content_hash_covers_what_decides_the_actions(env_id: str) -> None:
    def hash_of(name: str, seed: int = 0, **arguments: Any) -> str:
        return make_baseline(name, setup_of(env_id, **arguments), seed=seed).content_hash

    name = {PENDULUM: "max_torque", CART_POLE: "force_mag"}.get(env_id, "max_force")
    limit = {name: 1.5}
    hashes = {hash_of(name) for name in BASELINES}
    assert len(hashes) == len(BASELINES)
    changes: list[dict[str, Any]] = [limit, {"mass": 2.0}, {"damping": 0.1}, {"gravity": 9.0}]
    changes += [{"length": 2.0}, {"control_period": 0.1}]
    changes += [{"stiffness": 50.0}] if env_id == ELASTIC else [{"mass_distribution": "point"}]
    assert len({hash_of("handmade", **change) for change in changes} | hashes) == 3 + len(changes)
    assert hash_of("random", seed=1) not in hashes
    for integrator in ("explicit_euler", "reference"):
        assert hash_of("handmade", integrator=integrator) in hashes


def test_content_hash_is_the_same_in_every_process() -> None:
    code = (
        "import gymnasium as gym, integ_gym\n"
        "from integ_gym.train.baselines import BASELINES, make_baseline\n"
        "setup = gym.make('IntegPendulum-v0').unwrapped.setup\n"
        "print(*(make_baseline(name, setup).content_hash for name in BASELINES))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONHASHSEED": "77"},
        capture_output=True,
        text=True,
        check=True,
    )
    setup = setup_of(PENDULUM)
    assert done.stdout.split() == [make_baseline(n, setup).content_hash for n in BASELINES]


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("hand-made", {}, "unknown baseline 'hand-made'. Did you mean 'handmade'? Valid choices: "),
        ("handmade", {"gravity": 0.0}, "without gravity there is nothing to balance; leave"),
    ],
)
@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_refusals(env_id: str, name: str, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError) as caught:
        make_baseline(name, setup_of(env_id, **arguments))
    assert message in str(caught.value)


def test_one_plant_per_baseline() -> None:
    envs = gym.make_vec(
        PENDULUM, 2, vectorization_mode="vector_entry_point", mass=np.array([1.0, 1.1])
    )
    with pytest.raises(ValueError, match="mass has one value per lane; make one baseline per"):
        make_baseline("handmade", envs.unwrapped.setup)  # type: ignore[attr-defined]


# --- random and zero --------------------------------------------------------------------------


def test_random_is_uniform_and_has_no_memory() -> None:
    """Over a trajectory of neighbouring observations: uniform, and free of serial correlation."""
    n = 20_000
    angle = np.linspace(0.0, 0.5, n)
    observations = np.stack([np.cos(angle), np.sin(angle), angle], axis=1).astype(np.float32)
    policy = make_baseline("random", setup_of(PENDULUM, max_torque=3.0))
    actions = policy.act(observations)[:, 0]
    share_below = np.sort(actions / 6.0 + 0.5)
    assert np.abs(share_below - np.linspace(0.0, 1.0, n)).max() < 1.95 / math.sqrt(n)
    assert abs(np.corrcoef(actions[1:], actions[:-1])[0, 1]) < 4.0 / math.sqrt(n)
    assert abs(np.corrcoef(actions, angle)[0, 1]) < 4.0 / math.sqrt(n)
    order = np.random.default_rng(0).permutation(n)[:500]
    np.testing.assert_array_equal(policy.act(observations[order])[:, 0], actions[order])
    other = make_baseline("random", setup_of(PENDULUM, max_torque=3.0), seed=1)
    assert abs(np.corrcoef(other.act(observations)[:, 0], actions)[0, 1]) < 4.0 / math.sqrt(n)
    zeros = np.array([[0.0, 0.0, 0.0], [-0.0, 0.0, -0.0]])
    assert np.ptp(policy.act(zeros)) == 0.0


def test_random_choices_are_even() -> None:
    observations = np.random.default_rng(0).normal(size=(20_000, 4)).astype(np.float32)
    choices = make_baseline("random", setup_of(CART_POLE)).act(observations)
    assert set(choices) == {0, 1}
    assert abs(choices.mean() - 0.5) < 4.0 * 0.5 / math.sqrt(20_000)


@pytest.mark.parametrize("fallback", ["hold", "zero"])
@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
@pytest.mark.parametrize("latency", [0.0, 0.04])
def test_zero_never_acts(env_id: str, fallback: str, latency: float) -> None:
    arguments = {"integrator": "rk4", "dt": 0.02, "action_latency": latency, "fallback": fallback}
    env = gym.make(env_id, **arguments)
    policy = make_baseline("zero", env.unwrapped.setup)  # type: ignore[attr-defined]
    observation, _ = env.reset(seed=0)
    for _ in range(30):
        action = policy.act(observation[None])[0]
        observation, _, _, _, info = env.step(action)
        assert info["control"] == 0.0
        assert info["fallback_used"] is True or env_id != CART_POLE
        assert info["actuator_work"] == 0.0


@pytest.mark.parametrize("name", ["random", "zero"])
def test_no_skill_does_not_succeed(name: str) -> None:
    assert play(PENDULUM, name, 20, **(TIGHT | {"integrator": "rk4"})).success == 0.0
    for env_id in (CART_POLE, SWING_UP, ELASTIC):
        assert play(env_id, name, 20, integrator="rk4").success == 0.0


# --- the hand-made controllers ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("max_torque", "latest"), [(0.7, 8.0), (0.8, 7.6), (1.0, 6.0), (1.25, 4.6), (2.0, 4.2)]
)
def test_swing_up_under_tight_torque_limits(max_torque: float, latest: float) -> None:
    result = play(PENDULUM, "handmade", **TIGHT, max_torque=max_torque)
    assert result.success == 1.0
    assert result.since.max() <= latest
    assert np.abs(result.controls).max() <= max_torque


@pytest.mark.parametrize(
    "arguments",
    [
        {"integrator": "explicit_euler"},
        {"integrator": "symplectic_euler"},
        {"integrator": "rk4", "dt": 0.01, "control_period": 0.05},
        {"dt": 0.01},
        {"dt": 0.1},
        {"start": "uniform", "max_torque": 0.8},
        {"mass": 1.3, "length": 0.7, "gravity": 9.81, "damping": 0.02},
        {"mass_distribution": "point", "gravity": 9.81, "max_torque": 2.5},
        {"mass_distribution": "point", "gravity": 9.81, "max_torque": 20.0},
        {"observation_noise": 0.02},
    ],
    ids=str,
)
def test_swing_up_elsewhere(arguments: dict[str, Any]) -> None:
    settings = TIGHT | {"integrator": "rk4", "max_torque": 1.0} | arguments
    assert play(PENDULUM, "handmade", **settings).success == 1.0


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"dt": 0.005, "control_period": 0.02, "integrator": "rk4"},
        {"dt": 0.05},
        {"integrator": "explicit_euler"},
        {"integrator": "implicit_euler"},
        {"mass_distribution": "point", "length": 0.8, "mass": 0.3, "cart_damping": 0.1},
        {"duration": 40.0, "integrator": "rk4"},
    ],
    ids=str,
)
def test_balance(arguments: dict[str, Any]) -> None:
    settings = {"integrator": "reference", "dt": 0.02} | arguments
    result = play(CART_POLE, "handmade", **settings)
    assert result.success == 1.0


@pytest.mark.parametrize(
    "arguments",
    [
        {"integrator": "reference", "dt": 0.02},
        {},
        {"control_period": 0.05},
        {"integrator": "explicit_euler", "dt": 0.02},
        {"integrator": "implicit_euler", "dt": 0.02},
        {"max_force": 5.0},
        {"mass": 0.3, "length": 0.8},
        {"mass_distribution": "point", "damping": 0.003},
        {"damping": 0.01},
        {"friction": 0.02, "cart_friction": 0.5},
        {"track_limit": 1.2, "observation_noise": 0.01},
        {"start": "upright"},
    ],
    ids=str,
)
def test_cart_pole_swing_up(arguments: dict[str, Any]) -> None:
    settings = {"integrator": "rk4", "dt": 0.005, "control_period": 0.02}
    if "dt" in arguments:
        settings = {}
    result = play(SWING_UP, "handmade", 20, **(settings | arguments))
    assert result.success == 1.0
    assert result.since.max() <= 7.0


@pytest.mark.parametrize(
    "arguments",
    [
        {"integrator": "reference"},
        {"integrator": "symplectic_euler"},
        {"integrator": "implicit_euler", "dt": 0.05},
        {"stiffness": 100.0, "damping": 0.1},
        {"mass": 2.0, "length": 0.6},
        {"control_period": 0.1},
    ],
    ids=str,
)
def test_elastic_pendulum_is_quieted(arguments: dict[str, Any]) -> None:
    assert play(ELASTIC, "handmade", 20, **({"dt": 0.02} | arguments)).success == 1.0


def test_where_the_integrator_drains_energy_no_skill_is_needed() -> None:
    """A success that is the simulator's own: without control, and only there."""
    assert play(ELASTIC, "zero", 20, integrator="implicit_euler", dt=0.05).success == 1.0
    assert play(ELASTIC, "zero", 20, integrator="reference", dt=0.05).success == 0.0


@pytest.mark.parametrize("missing", [-0.1, 0.1])
@pytest.mark.parametrize(("theta", "direction"), [(2.0, 1), (-2.5, -1), (math.pi, 1), (1.2, -1)])
def test_pumping_does_the_work_that_is_missing(
    theta: float, direction: int, missing: float
) -> None:
    """Where the torque suffices, one period brings the energy to that of standing upright."""
    env = gym.make(PENDULUM, integrator="reference", dt=0.01, max_torque=5.0, damping=0.3)
    controller = EnergyShaping(env.unwrapped.setup)  # type: ignore[attr-defined]
    plant = controller.plant
    upright = 2.0 * plant.gravity_torque
    kinetic = upright - missing - plant.gravity_torque * (1.0 + math.cos(theta))
    theta_dot = direction * math.sqrt(2.0 * kinetic / plant.inertia)
    env.reset(options={"state": (theta, theta_dot)})
    torque = controller.pump(np.array([theta]), np.array([theta_dot]))
    *_, info = env.step(torque)
    assert info["energy"] == pytest.approx(upright, abs=0.03 * abs(missing))


def test_at_rest_hanging_it_starts_to_move() -> None:
    controller = make_baseline("handmade", setup_of(PENDULUM))
    hanging = np.array([[-1.0, 0.0, 0.0]])
    assert abs(controller.act(hanging)[0, 0]) == 2.0


def test_the_regulator_takes_over_only_where_it_catches() -> None:
    """From every state that it claims, the regulator alone brings the plant to rest upright."""
    env = gym.make(PENDULUM, **TIGHT, max_torque=0.8, duration=6.0)
    controller = EnergyShaping(env.unwrapped.setup)  # type: ignore[attr-defined]
    rng = np.random.default_rng(0)
    angle, speed = rng.uniform(-1.2, 1.2, 4000), rng.uniform(-6.0, 6.0, 4000)
    claimed = np.flatnonzero(controller.region.holds(angle, speed))
    assert 20 < claimed.size < 1000
    assert controller.region.holds(np.array([0.0]), np.array([0.0])).all()
    for index in claimed[:20]:
        env.reset(options={"state": (angle[index], speed[index])})
        truncated = False
        while not truncated:
            theta, theta_dot = env.unwrapped.state  # type: ignore[attr-defined]
            torque = controller.regulate(np.array([theta]), np.array([theta_dot]))
            *_, truncated, info = env.step(torque)
        assert info["success"]


# --- linear-quadratic design ------------------------------------------------------------------


def test_linearization_of_the_pendulum() -> None:
    plant = setup_of(PENDULUM, mass=2.0, length=0.5, damping=0.3).plant
    a, b = linearized(plant)
    np.testing.assert_allclose(
        a, [[0.0, 1.0], [1.5 * 10.0 / 0.5, -0.3 / plant.inertia]], rtol=1e-8, atol=1e-9
    )
    np.testing.assert_allclose(b, [[0.0], [1.0 / plant.inertia]], rtol=1e-8, atol=1e-9)


def test_linearization_of_the_cart_pole() -> None:
    """Against M q̈ = G q + F solved by hand: M = [[m+M, ml], [ml, I]], G = diag(0, mgl)."""
    plant = setup_of(CART_POLE).plant
    mass_matrix = np.array([[1.1, 0.05], [0.05, 4.0 / 3.0 * 0.1 * 0.25]])
    stiffness = np.linalg.solve(mass_matrix, np.diag([0.0, 0.1 * 9.8 * 0.5]))
    push = np.linalg.solve(mass_matrix, [1.0, 0.0])
    a, b = linearized(plant)
    np.testing.assert_allclose(a[[1, 3]][:, [0, 2]], stiffness, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(a[[0, 2]], [[0, 1, 0, 0], [0, 0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(b.ravel(), [0.0, push[0], 0.0, push[1]], rtol=1e-8, atol=1e-9)


def test_held_is_the_environment_s_own_map_near_upright() -> None:
    env = gym.make(PENDULUM, **TIGHT, damping=0.2)
    a, b = held(*linearized(env.unwrapped.setup.plant), 0.05)  # type: ignore[attr-defined]
    state, torque = np.array([1e-4, -2e-4]), 1e-4
    env.reset(options={"state": state})
    env.step(np.array([torque]))
    expected = a @ state + b[:, 0] * torque
    np.testing.assert_allclose(env.unwrapped.state, expected, rtol=1e-6)  # type: ignore[attr-defined]


def test_lqr_gain_of_a_scalar_system() -> None:
    """x ← x + u with Q = R = 1: P is the golden ratio, K = P / (1 + P)."""
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    one = np.eye(1)
    np.testing.assert_allclose(lqr_gain(one, one, one, one), [[golden / (1.0 + golden)]])


def test_a_system_that_cannot_be_held_is_refused() -> None:
    with pytest.raises(ValueError, match="no linear control holds this plant upright"):
        lqr_gain(2.0 * np.eye(1), np.zeros((1, 1)), np.eye(1), np.eye(1))


def test_missing_scipy_names_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy", None)
    monkeypatch.delitem(sys.modules, "scipy.linalg", raising=False)
    with pytest.raises(ModuleNotFoundError) as caught:
        make_baseline("handmade", setup_of(PENDULUM))
    assert str(caught.value) == 'scipy is not installed; run: pip install "integ-gym[train]"'
