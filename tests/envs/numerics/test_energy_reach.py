"""What a search over controls reaches, against what can be said by hand."""

import math

import numpy as np
import pytest

from integ_gym.envs import numerics
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.settings import Setup

HANGING = np.array([math.pi, 0.0])


def setup(max_torque: float, env_id: str = "IntegPendulum-v0", **arguments: object) -> Setup:
    given = {"integrator": "rk4", "dt": 0.05, "control_period": 0.05, **arguments}
    return environment_setup(env_id, {**given, "max_torque": max_torque})


def test_goal_energy_is_that_of_rest_at_the_goals_edge() -> None:
    """A rod of 1 kg and 1 m under 10 m/s² has m g l / 2 (1 + cos θ)."""
    assert numerics.goal_energy(setup(1.0)) == pytest.approx(5.0 * (1.0 + math.cos(0.2)))
    balance = environment_setup("IntegCartPole-v0", {})
    assert numerics.goal_energy(balance) is None


@pytest.mark.parametrize(
    ("integrator", "dt", "critical"),
    [
        ("explicit_euler", 0.05, 0.133), ("symplectic_euler", 0.05, 0.573), ("rk4", 0.05, 0.519),
        ("implicit_euler", 0.0125, 0.661), ("implicit_euler", 0.025, 0.840),
        ("implicit_euler", 0.05, 1.129),
    ],
)  # fmt: skip
def test_critical_torque(integrator: str, dt: float, critical: float) -> None:
    """Of the rod, from rest, for the goal's energy within 8 s: as in docs/explanation/atlas.md."""
    made = setup(1.0, integrator=integrator, dt=dt)
    found = numerics.critical_limit(made, HANGING, 8.0, 0.05, 3.0)
    assert found == pytest.approx(critical, abs=2e-3)


def test_what_cannot_be_reached_is_said() -> None:
    with pytest.raises(ValueError, match=r"not reached within 8 s with 0\.2"):
        numerics.critical_limit(setup(1.0), HANGING, 8.0, 0.05, 0.2)


@pytest.mark.filterwarnings("error")
def test_a_search_in_which_forces_diverge_warns_of_nothing() -> None:
    given = {"integrator": "explicit_euler", "dt": 0.04, "control_period": 0.04}
    made = environment_setup("IntegCartPoleSwingUp-v0", given)
    starts = np.tile([0.0, 0.0, math.pi, 0.0], (64, 1))
    limits = np.geomspace(1e-4, 1.0, 64)
    found = numerics.reach(made, starts, 20.0, 0.97, limits)
    assert not np.isfinite(found.states).all()
    assert np.isfinite(found.time).any()
