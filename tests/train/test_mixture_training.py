"""Both trainers train on mixtures; the fleet keeps every integrator's share of its lanes."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import gymnasium as gym
import jax
import numpy as np
import pytest
from fleet_runs import small_run
from small_ppo import trained
from stable_baselines3 import PPO

from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.config import TrainingEvidence
from integ_gym.train.fleet.planning import kind_of, plan
from integ_gym.train.fleet.training import _Trainer, train_chunk, train_fleet, write_outcome
from integ_gym.train.fleet.worker import Workers
from integ_gym.train.policy_files.sidecar import read_trained
from integ_gym.train.ppo import PPOConfig

PERIOD, HORIZON, LANES = 0.05, 8, 8
MIXTURE = [
    {"integrator": "explicit_euler", "dt": 0.05, "weight": 2},
    {"integrator": "rk4", "dt": 0.05, "weight": 1},
    {"integrator": "rk4", "dt": 0.0125, "weight": 3},
    {"integrator": "implicit_midpoint", "dt": 0.025},
    {"integrator": "reference", "dt": 0.05},
]
SHARES = {"explicit_euler": 0.25, "rk4": 0.5, "implicit_midpoint": 0.125, "reference": 0.125}
CONFIG = PPOConfig.of(
    "IntegPendulum-v0",
    env_arguments={"mixture": MIXTURE, "control_period": PERIOD, "duration": HORIZON * PERIOD},
    n_envs=LANES,
    n_steps=32,
    batch_size=64,
    n_epochs=2,
    net_arch=(16, 8),
    total_steps=1024,
    trace_every=1,
)
PERIODS = [
    {"integrator": "rk4", "dt": 0.05, "control_period": 0.05},
    {"integrator": "rk4", "dt": 0.05, "control_period": 0.1},
    {"integrator": "explicit_euler", "dt": 0.05, "control_period": 0.2, "weight": 2},
]
SEVERAL = replace(CONFIG, env_arguments={"mixture": PERIODS, "duration": HORIZON * PERIOD})
HOMES = [{k: x for k, x in member.items() if k != "weight"} for member in MIXTURE]
CONTEXT = EpisodeContext("run", "cell", phase="training", training_discretization=HOMES)


@pytest.fixture(scope="module", params=["sb3", "fleet"])
def run(request, tmp_path_factory):
    """A policy trained on the mixture, and the records of its training episodes."""
    return _run(CONFIG, request.param, tmp_path_factory.mktemp("run"))


def _run(config, trainer, folder):
    evidence = [TrainingEvidence(folder / "evidence", "training", CONTEXT)]
    if trainer == "sb3":
        policy = trained(config, folder, evidence=evidence)
    else:
        (outcome,) = train_chunk([config], evidence)
        policy = write_outcome(config, outcome, folder)
    store = EvidenceStore(folder / "evidence")
    assert store.verify() == []
    return policy, sorted(store.records(), key=lambda r: r["episode_index"])


def test_every_record_says_what_its_episode_ran_on(run):
    """Replayed on the discretization that it names, its commands lead to its states."""
    _, records = run
    drawn = Counter((r["integrator"], r["dt"]) for r in records)
    assert set(drawn) == {(m["integrator"], m["dt"]) for m in MIXTURE}
    seen = set()
    for record in records:
        pair = record["integrator"], record["dt"]
        assert record["substeps"] == round(PERIOD / record["dt"])
        if pair not in seen:
            seen.add(pair)
            _replay(record)


def _replay(record):
    env = gym.make("IntegPendulum-v0", **record.arguments())
    env.reset(options={"state": record["initial_state"]})
    states = np.stack([record["theta"], record["theta_dot"]], axis=1)
    tolerance = 1e-12 if record["float_width"] == 64 else 2e-5
    for command, state in zip(record["torque_commanded"], states[1:], strict=True):
        env.step(np.array([command], dtype=np.float64))
        np.testing.assert_allclose(env.unwrapped.state, state, rtol=tolerance, atol=tolerance)


def test_shares_are_those_of_the_mixture(run):
    policy, records = run
    count = len(records)
    assert count == CONFIG.total_steps // HORIZON
    by_integrator = Counter(r["integrator"] for r in records)
    coarse = [r["dt"] == 0.05 for r in records if r["integrator"] == "rk4"]
    if policy.card["trainer"] == "fleet":
        assert by_integrator == {name: share * count for name, share in SHARES.items()}
    else:
        for name, share in SHARES.items():
            spread = 4 * np.sqrt(share * (1 - share) / count)
            np.testing.assert_allclose(by_integrator[name] / count, share, atol=spread)
    np.testing.assert_allclose(np.mean(coarse), 0.25, atol=4 * np.sqrt(0.25 * 0.75 / len(coarse)))


def test_an_environment_draws_anew_at_its_resets(run):
    """The fleet's integrators stay with their lanes; steps, and SB3's integrators, do not."""
    policy, records = run
    lanes = {}
    for place, record in enumerate(records):
        lanes.setdefault(place % LANES, []).append((record["integrator"], record["dt"]))
    changed = [len({dt for _, dt in drawn}) > 1 for drawn in lanes.values()]
    moved = [len({name for name, _ in drawn}) > 1 for drawn in lanes.values()]
    if policy.card["trainer"] == "fleet":
        assert sum(changed) == LANES // 2
        assert not any(moved)
    else:
        assert all(changed)
        assert all(moved)


def test_the_sidecar_states_the_mixture(run):
    policy, records = run
    card = policy.card
    assert card["discretization"] is None
    stated = [(m["integrator"], m["dt"], m["share"]) for m in card["mixture"]]
    assert stated == [
        (m["integrator"], m["dt"], pytest.approx(m.get("weight", 1) / 8)) for m in MIXTURE
    ]
    assert {m["control_period"] for m in card["mixture"]} == {PERIOD}
    assert "every reset" in card["mixture_drawn"]
    assert not {"integrator", "dt", "engine"} & set(card["env_arguments"])
    assert card["env_arguments"]["control_period"] == PERIOD
    assert PPOConfig(**card["config"]) == CONFIG
    assert read_trained(policy.policy)[0].policy_id == "ppo-mixture-seed0"
    assert records[0]["training_discretization"].count("integrator") == len(MIXTURE)


@pytest.mark.parametrize("trainer", ["sb3", "fleet"])
def test_episodes_of_a_mixture_decide_at_their_members_control_period(trainer, tmp_path):
    policy, records = _run(SEVERAL, trainer, tmp_path)
    seen = Counter((r["integrator"], r["control_period"]) for r in records)
    assert set(seen) == {(m["integrator"], m["control_period"]) for m in PERIODS}
    for record in records:
        assert record["length"] == round(HORIZON * PERIOD / record["control_period"])
        _replay(record)
    card = policy.card
    stated = [(m["control_period"], m["share"]) for m in card["mixture"]]
    assert stated == [(0.05, 0.25), (0.1, 0.25), (0.2, 0.5)]
    assert "control_period" not in card["env_arguments"]
    mean, each = np.exp(-0.1375), [np.exp(-period) for period in (0.05, 0.1, 0.2)]
    assert card["derived"]["gamma"] == pytest.approx(each if trainer == "fleet" else mean)
    assert PPO.load(policy.policy).gamma == pytest.approx(mean)


def test_the_fleet_discounts_by_the_control_period_of_each_episode():
    """Advantages of a rollout, added up step by step."""
    fleet = _Trainer(kind_of(SEVERAL), [SEVERAL])
    learner, knobs = fleet._new(), fleet._knobs()
    program, (config,) = fleet._program, fleet._configs
    _, steps = jax.jit(program._collect)(learner, learner.keys, fleet._params)
    _, outcome, *observed = jax.jit(program._again)(steps, fleet._params)
    batch = jax.jit(program._batch)(learner.stack, knobs, steps, outcome, tuple(observed))
    member = np.asarray(steps.member[0])[:, 0]
    assert set(member.ravel()) == {0, 1, 2}
    gamma = np.exp(-np.array([0.05, 0.1, 0.2]) / config.discount_time)[member]
    flat = (np.asarray(x).reshape(x.shape[0], -1) for x in observed)
    value = (_critic(learner.stack, x).reshape(member.shape) for x in flat)
    now, later = value
    ended = np.asarray(steps.terminated | steps.truncated)[:, 0]
    reward = np.asarray(outcome.reward)[:, 0] * config.reward_scale
    expected, after = np.zeros(member.shape), np.zeros(LANES)
    for t in reversed(range(len(member))):
        delta = reward[t] + gamma[t] * later[t] - now[t]
        after = delta + gamma[t] * config.gae_lambda * np.where(ended[t], 0.0, after)
        expected[t] = after
    found = np.asarray(batch.advantages)[0].reshape(LANES, -1).T
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)


def _critic(stack, observed):
    """Values of observations, shape (obs, n), by the critic's weights."""
    layers = list(zip(stack.weights, stack.biases, strict=True))
    for place, (weight, bias) in enumerate(layers):
        observed = np.asarray(weight)[0, 1] @ observed + np.asarray(bias)[0, 1][:, None]
        observed = np.tanh(observed) if place < len(layers) - 1 else observed
    return observed[0]


def test_policies_of_a_mixture_do_not_depend_on_their_neighbours():
    """Also where seed, plant and the steps themselves differ within the chunk."""
    finer = [{**member, "dt": member["dt"] / 2} for member in MIXTURE]
    other = replace(
        CONFIG, seed=3, env_arguments={**CONFIG.env_arguments, "mass": 1.5, "mixture": MIXTURE}
    )
    apart = replace(other, env_arguments={"mixture": finer, "control_period": PERIOD})
    one = Workers(1, "cpu")
    assert len(plan([CONFIG, other], one)) == 1
    assert len(plan([CONFIG, apart], one)) == 2
    together, beside = train_chunk([other, CONFIG]), train_chunk([replace(other, seed=9), CONFIG])
    for name, value in together[1].weights.items():
        np.testing.assert_array_equal(beside[1].weights[name], value, err_msg=name)
        assert not np.array_equal(together[0].weights[name], value)


def test_every_integrator_has_its_share_where_episodes_end_early(tmp_path):
    members = [{"integrator": "implicit_euler", "dt": 0.01}, {"integrator": "rk4", "dt": 0.02}]
    arguments = {"mixture": members, "control_period": 0.02, "duration": 0.4}
    config = small_run("IntegCartPole-v0", env_arguments=arguments, n_steps=64, total_steps=512)
    (outcome,) = train_chunk([config], [TrainingEvidence(tmp_path, "training", CONTEXT)])
    assert all(np.isfinite(value).all() for value in outcome.weights.values())
    decisions = Counter()
    for record in EvidenceStore(tmp_path).records():
        assert record["dt"] == {"implicit_euler": 0.01, "rk4": 0.02}[record["integrator"]]
        decisions[record["integrator"]] += record["length"]
    unfinished = 2 * 20
    assert all(256 - unfinished <= count <= 256 for count in decisions.values())
    assert len(decisions) == 2


def test_shares_that_are_no_whole_lanes_are_refused(tmp_path):
    odd = replace(CONFIG, n_envs=12, batch_size=32)
    with pytest.raises(ValueError, match=r"12 environments .* multiple of 8"):
        train_fleet([odd], [tmp_path])
