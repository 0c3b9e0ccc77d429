"""Hand-made controllers: what they reach on the truth, and how."""

from __future__ import annotations

import math
import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from playing import CART_POLE, ELASTIC, PENDULUM, SWING_UP, TIGHT, play, setup_of

from integ_gym.train.baselines import make_baseline
from integ_gym.train.controllers import EnergyShaping

pytest.importorskip("scipy")


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


def test_missing_scipy_names_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy", None)
    monkeypatch.delitem(sys.modules, "scipy.linalg", raising=False)
    with pytest.raises(ModuleNotFoundError) as caught:
        make_baseline("handmade", setup_of(PENDULUM))
    assert str(caught.value) == 'scipy is not installed; run: pip install -e ".[report]"'
