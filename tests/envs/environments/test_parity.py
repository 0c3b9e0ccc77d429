"""At Gymnasium's own discretization the environments are Gymnasium's."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.classic_control.acrobot import AcrobotEnv
from gymnasium.envs.classic_control.cartpole import CartPoleEnv
from gymnasium.envs.classic_control.pendulum import PendulumEnv

from integ_gym.envs.catalogue.acrobot import IntegAcrobotEnv
from integ_gym.envs.catalogue.cart_pole import IntegCartPoleEnv
from integ_gym.envs.catalogue.pendulum import IntegPendulumEnv

STEPS = 300
ULP_BELOW_8 = float(np.spacing(np.nextafter(np.float32(8), np.float32(0))))
"""One float32 ulp of an angular velocity at the stock speed limit."""


def _pendulum_states(rng):
    return np.stack([rng.uniform(-10, 10, STEPS), rng.uniform(-8, 8, STEPS)], axis=1)


def _cart_pole_states(rng):
    return rng.uniform((-2.5, -3.0, -0.25, -3.0), (2.5, 3.0, 0.25, 3.0), (STEPS, 4))


@pytest.mark.parametrize(
    ("dtype", "state_tolerance", "reward_tolerance"),
    [(np.float64, 1e-12, 1e-12), (np.float32, None, 1e-6)],
)
def test_pendulum_step(dtype, state_tolerance, reward_tolerance):
    rng = np.random.default_rng(0)
    ours, stock = IntegPendulumEnv(max_speed=8.0), PendulumEnv()
    stock.reset(seed=0)
    for state in _pendulum_states(rng):
        action = rng.uniform(-3, 3, 1).astype(dtype)
        ours.reset(options={"state": state})
        stock.state = state.copy()
        obs, reward, terminated, truncated, _ = ours.step(action)
        stock_obs, stock_reward, stock_terminated, _, _ = stock.step(action)
        if state_tolerance:
            np.testing.assert_allclose(ours.state, stock.state, rtol=0, atol=state_tolerance)
            np.testing.assert_array_max_ulp(obs, stock_obs, maxulp=1)
        np.testing.assert_allclose(obs, stock_obs, rtol=0, atol=ULP_BELOW_8)
        assert reward == pytest.approx(float(stock_reward), abs=reward_tolerance)
        assert (terminated, truncated) == (stock_terminated, False)


def test_acrobot_step():
    """From states up to the speed limits, which some steps pass; angles to whole turns."""
    far = np.pi * np.array([1.0, 1.0, 4.0, 9.0])
    ours, stock, ended = IntegAcrobotEnv(), AcrobotEnv(), 0
    stock.reset(seed=0)
    for state in np.random.default_rng(0).uniform(-far, far, (STEPS, 4)):
        for action in range(3):
            ours.reset(options={"state": state})
            stock.state = state.copy()
            obs, reward, terminated, _, info = ours.step(action)
            stock_obs, stock_reward, stock_terminated, _, _ = stock.step(action)
            error = ours.state - stock.state
            error[:2] = (error[:2] + np.pi) % (2.0 * np.pi) - np.pi
            assert (np.abs(error) < 1e-12 * (1.0 + np.abs(stock.state))).all()
            np.testing.assert_allclose(obs, stock_obs, rtol=1e-6, atol=1e-6)
            assert (reward, terminated) == (stock_reward, stock_terminated)
            assert info["success"] == terminated
            ended += terminated
    assert 0 < ended < 3 * STEPS


@pytest.mark.parametrize("sutton_barto", [False, True])
def test_cart_pole_after_its_end(sutton_barto):
    """Gymnasium pays the fall once, and warns whoever goes on."""
    ours = IntegCartPoleEnv(sutton_barto_reward=sutton_barto)
    stock = CartPoleEnv(sutton_barto_reward=sutton_barto)
    for _ in range(2):
        ours.reset(seed=0), stock.reset(seed=0)
        paid, warned = [], []
        for env in (ours, stock):
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                paid.append([env.step(1)[1:3] for _ in range(20)])
            warned.append(["reset()" in str(warning.message) for warning in caught])
        assert paid[0] == paid[1]
        assert paid[0][-1] == (-1.0 if sutton_barto else 0.0, True)
        assert warned[0] == warned[1] == [True]


@pytest.mark.parametrize("sutton_barto", [False, True])
def test_cart_pole_step(sutton_barto):
    rng = np.random.default_rng(2)
    ours = IntegCartPoleEnv(sutton_barto_reward=sutton_barto)
    stock = CartPoleEnv(sutton_barto_reward=sutton_barto)
    stock.reset(seed=0)
    ended = 0
    for state in _cart_pole_states(rng):
        action = int(rng.integers(2))
        ours.reset(options={"state": state})
        stock.state, stock.steps_beyond_terminated = state.copy(), None
        obs, reward, terminated, _, _ = ours.step(action)
        stock_obs, stock_reward, stock_terminated, _, _ = stock.step(action)
        np.testing.assert_allclose(ours.state, stock.state, rtol=0, atol=1e-12)
        np.testing.assert_array_max_ulp(obs, stock_obs, maxulp=1)
        assert (reward, terminated) == (stock_reward, stock_terminated)
        ended += terminated
    assert 0 < ended < STEPS


@pytest.mark.parametrize(
    ("ours", "stock", "options"),
    [
        ("IntegPendulum-v0", "Pendulum-v1", None),
        ("IntegPendulum-v0", "Pendulum-v1", {"x_init": 0.4, "y_init": 0.1}),
        ("IntegCartPole-v0", "CartPole-v1", None),
        ("IntegCartPole-v0", "CartPole-v1", {"low": -0.2, "high": 0.1}),
        ("IntegAcrobot-v0", "Acrobot-v1", None),
        ("IntegAcrobot-v0", "Acrobot-v1", {"low": -0.2, "high": 0.1}),
    ],
)
def test_same_seed_same_start_and_rollout_length(ours, stock, options):
    ours, stock = gym.make(ours), gym.make(stock)
    for seed in (0, 7):
        for env_seed in (seed, None):
            obs, _ = ours.reset(seed=env_seed, options=options)
            stock_obs, _ = stock.reset(seed=env_seed, options=options)
            np.testing.assert_array_max_ulp(obs, stock_obs, maxulp=1)
            np.testing.assert_array_equal(ours.unwrapped.state, stock.unwrapped.state)
    ours.action_space.seed(3)
    steps = 0
    while steps < 600:
        steps += 1
        action = ours.action_space.sample()
        ended = ours.step(action)[2:4]
        assert ended == stock.step(action)[2:4]
        if any(ended):
            break
    assert steps > 5


def test_speed_limit_gives_the_stock_spaces():
    ours, stock = gym.make("IntegPendulum-v0", max_speed=8.0), gym.make("Pendulum-v1")
    assert ours.observation_space == stock.observation_space
    assert ours.action_space == stock.action_space
    for ours, stock in (("IntegCartPole-v0", "CartPole-v1"), ("IntegAcrobot-v0", "Acrobot-v1")):
        ours, stock = gym.make(ours), gym.make(stock)
        assert ours.observation_space == stock.observation_space
        assert ours.action_space == stock.action_space
