"""Records of environments of others are played again from their seeds."""

from __future__ import annotations

import numpy as np
import pytest

import integ_gym
from integ_gym.evidence.replaying import replay
from integ_gym.evidence.store import EvidenceStore


def hop(observation):
    return 0.9 * np.tanh(observation[-3:])


def step(observation):
    return int(observation[0] > 0.0)


@pytest.mark.parametrize(
    ("policy", "env_id", "integrator", "dt", "varied", "environment"),
    [
        (
            hop, "Hopper-v5", "RK4", 0.002,
            {"control_period": [0.008, 0.016], "solver": {"iterations": [1, 100]}},
            {"success_return": 100.0},
        ),
        (
            hop, "Hopper-v5", "RK4", 0.002, {"hold_probability": [0.0, 0.2]},
            {"action_latency": 0.004, "latency_jitter": 0.01},
        ),
        (step, "CartPole-v1", "explicit_euler", 0.02, {"control_period": [0.02, 0.04]}, {}),
        (
            step, "CartPole-v1", "explicit_euler", 0.02,
            {"hold_probability": [0.2], "latency_jitter": [0.0, 0.04]}, {},
        ),
    ],
)  # fmt: skip
def test_every_record_comes_out_to_the_last_bit(
    policy, env_id, integrator, dt, varied, environment, tmp_path
):
    integ_gym.evaluate(
        policy, env_id, tmp_path, home="stock", integrators=[integrator], dts=[dt], episodes=3,
        varied=varied, at=["home"], environment=environment, workers=1, progress=False,
        on_doubt=lambda doubt: None,
    )  # fmt: skip
    records = list(EvidenceStore(tmp_path / "evidence").named_records())
    done = replay(records, exact=True).settle()
    assert done.findings == []
    assert done.skipped == {}
    assert done.exact == done.records == len(records)
    file, forged = records[0]
    forged.trace["reward"] = forged.trace["reward"] + 1e-9
    assert replay([(file, forged)], exact=True).settle().findings
