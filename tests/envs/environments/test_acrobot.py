"""The acrobot's swing-up: its motion written again, against the truth, and its reward."""

import math

import gymnasium as gym
import numpy as np
import pytest
from scipy.integrate import solve_ivp


def _swung(p, state, torque, period):
    """State, work and loss by SciPy: the book's equations of two links, joint by joint."""

    def rates(_, y):
        first, second, first_dot, second_dot = y[:4]
        bent, pull = math.cos(second), p.mass_2 * p.length_1 * p.centre_2 * math.sin(second)
        own = p.inertia_2 + p.mass_2 * p.centre_2**2
        shared = own + p.mass_2 * p.length_1 * p.centre_2 * bent
        whole = (
            p.inertia_1 + p.mass_1 * p.centre_1**2 + p.mass_2 * p.length_1**2
            + 2.0 * shared - own
        )  # fmt: skip
        lower = p.mass_2 * p.centre_2 * p.gravity * math.sin(first + second)
        upper = (p.mass_1 * p.centre_1 + p.mass_2 * p.length_1) * p.gravity * math.sin(first)
        forces = [
            pull * second_dot * (2.0 * first_dot + second_dot)
            - upper - lower - p.damping * first_dot,
            torque - pull * first_dot**2 - lower - p.damping * second_dot,
        ]  # fmt: skip
        turned = np.linalg.solve([[whole, shared], [shared, own]], forces)
        lost = p.damping * (first_dot**2 + second_dot**2)
        return [first_dot, second_dot, *turned, torque * second_dot, lost]

    start = (*state, 0.0, 0.0)
    end = solve_ivp(rates, (0.0, period), start, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    return end[:4], end[4], end[5]


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_the_truth_is_the_motion_written_again(damping):
    """State, work and loss after every decision, from the same start, to 1e-10."""
    env = gym.make("IntegAcrobotSwingUp-v0", integrator="reference", damping=damping).unwrapped
    period = env.setup.timing.control_period
    env.reset(seed=1)
    env.action_space.seed(1)
    for _ in range(60):
        before = env.state
        *_, info = env.step(env.action_space.sample())
        expected, work, lost = _swung(env.setup.plant, before, info["control"], period)
        np.testing.assert_allclose(env.state, expected, rtol=0, atol=1e-10)
        assert info["actuator_work"] == pytest.approx(work, abs=1e-10)
        assert info["dissipated"] == pytest.approx(lost, abs=1e-10)
        assert abs(info["energy_residual"]) < 1e-10
    assert np.abs(env.state[:2]).max() > 0.5


@pytest.mark.parametrize("period", [0.02, 0.04])
def test_the_reward_is_a_rate_of_height_and_gentleness_at_the_start_of_a_period(period):
    times = {"dt": 0.02, "control_period": period}
    env = gym.make("IntegAcrobotSwingUp-v0", integrator="rk4", **times).unwrapped
    env.reset(seed=3)
    assert np.abs(env.state).max() <= 0.1
    assert np.ptp(env.state) > 0.0
    env.reset(options={"state": (2.5, 0.4, 1.0, -2.0)})
    env.action_space.seed(3)
    for _ in range(20):
        first, second, *_ = env.state
        action = env.action_space.sample()
        _, reward, terminated, *_ = env.step(action)
        height = 0.25 * (1.0 - math.cos(first)) * (1.0 - math.cos(first + second))
        gentle = 1.0 - 0.1 * (float(action[0]) / 20.0) ** 2
        assert reward == pytest.approx(height * gentle * period / 0.02, abs=1e-12)
        assert not terminated
    assert reward > 0.0
