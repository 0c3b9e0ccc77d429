"""Records of environments of others are played again from their seeds."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import integ_gym
from integ_gym.evidence.replaying import replay
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy import BoxActions, MlpPolicy


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


def test_what_a_network_decided_on_another_engine_is_decided_again_to_the_last_bit(tmp_path):
    """Second horizons have no traces, and a network's last bits depend on how much it is shown."""
    rng, sizes = np.random.default_rng(0), (3, 64, 64, 1)
    layers = tuple(
        (rng.normal(size=(n, m)).astype(np.float32), rng.normal(size=n).astype(np.float32))
        for m, n in pairwise(sizes)
    )
    policy = MlpPolicy(layers, "Tanh", BoxActions(np.array([-0.5]), np.array([0.5])))
    integ_gym.evaluate(
        policy, "IntegPendulum-v0", tmp_path, integrators=["Euler"], dts=[0.05], episodes=10,
        home={"engine": "mujoco", "integrator": "Euler", "dt": 0.05, "control_period": 0.05},
        environment={"duration": 2.0, "max_torque": 0.5}, workers=1, progress=False,
    )  # fmt: skip
    store = EvidenceStore(tmp_path / "evidence")
    decided = store.query(
        "SELECT record_id FROM records WHERE phase = 'second_horizon' AND engine = 'mujoco' "
        "AND policy_id = 'mlp'"
    )
    names = frozenset(decided.column("record_id").to_pylist())
    done = replay(
        list(store.named_records(names)), exact=True, policy=lambda record: policy.act
    ).settle()
    assert done.exact == len(names) > 0
    assert not done.findings
