"""What the atlas lets expect of a training, said before it, which never stands in its way."""

from __future__ import annotations

import pytest

from integ_gym.envs import ENVIRONMENTS
from integ_gym.eval import doubt

NEAR = {"max_torque": 0.7, "start": "hanging", "duration": 10.0, "dt": 0.05}


def test_a_loss_that_is_expected_is_said():
    told = doubt("IntegPendulum-v0", {**NEAR, "integrator": "symplectic_euler"})
    assert told is not None
    assert told.startswith(
        "a policy that learns on symplectic_euler dt=0.05 is expected to lose 0."
    )


@pytest.mark.parametrize(
    ("env_id", "arguments"),
    [
        *((env_id, {}) for env_id in ENVIRONMENTS),
        *((env_id, {"integrator": "rk4", "dt": 0.05}) for env_id in ENVIRONMENTS),
        ("IntegPendulum-v0", {**NEAR, "integrator": "rk4"}),
        ("IntegPendulum-v0", {**NEAR, "engine": "mujoco", "integrator": "Euler"}),
        ("IntegPendulum-v0", {"mixture": [{"integrator": "rk4", "dt": 0.05}]}),
        ("Hopper-v5", {"integrator": "RK4", "dt": 0.004}),
        ("CartPole-v1", {}),
        ("my_task:Settle-v0", {}),
    ],
)
def test_where_nothing_is_known_or_lost_nothing_is_said(env_id, arguments):
    assert doubt(env_id, arguments) is None
