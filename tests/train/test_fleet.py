"""The fleet trainer learns what stable-baselines3 (SB3) learns and writes the same files."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from functools import partial

import gymnasium as gym
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from engine_cases import needs
from fleet_runs import OF_EACH_ACTION, small_run
from pairing import in_turn
from safetensors.numpy import save
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.recomputing import recompute
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.config import TrainingEvidence
from integ_gym.train.fleet import training as fleet
from integ_gym.train.fleet.learning import (
    Adam,
    Algorithm,
    Batch,
    Knobs,
    Stack,
    initial_stack,
    orthogonal,
    permutations,
    state_dict,
    update,
)
from integ_gym.train.fleet.planning import kind_of
from integ_gym.train.fleet.program import FleetProgram
from integ_gym.train.fleet.training import train_chunk, train_in_stages, write_outcome
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.safetensors_file import FORMAT, read_safetensors
from integ_gym.train.policy_files.sidecar import read_trained
from integ_gym.train.ppo import make_training_envs, model_arguments
from integ_gym.train.vec_env import Sb3VecEnv, ScaledRewards


def _columns(config, learning_rate):
    one = {name: vars(config)[name] for name in Knobs._fields if name in vars(config)}
    one |= {"gamma": config.discount(0.05), "learning_rate_end": learning_rate}
    one |= {"learning_rate": learning_rate, "target_kl": config.target_kl or 0.0}
    return Knobs(*(jnp.asarray([one[name]], jnp.float32) for name in Knobs._fields))


def _stack_of(weights, discrete):
    """One policy's stack from the weights by SB3's names."""
    layers = sorted({key.split(".")[2] for key in weights if key.startswith("mlp_extractor")})
    kinds = []
    for kind in ("weight", "bias"):
        hidden = [
            np.stack(
                [weights[f"mlp_extractor.{net}_net.{n}.{kind}"] for net in ("policy", "value")]
            )
            for n in layers
        ]
        actor, critic = weights[f"action_net.{kind}"], weights[f"value_net.{kind}"]
        padded = np.zeros_like(actor)
        padded[:1] = critic
        kinds.append(tuple(x[None] for x in (*hidden, np.stack([actor, padded]))))
    log_std = np.zeros((1, 0), np.float32) if discrete else weights["log_std"][None]
    return Stack(kinds[0], kinds[1], log_std)


def _numpy_weights(model):
    return {k: v.detach().numpy().copy() for k, v in model.policy.state_dict().items()}


def _sb3_model(config):
    venv = ScaledRewards(Sb3VecEnv(make_training_envs(config)), config.reward_scale)
    model = PPO("MlpPolicy", venv, **model_arguments(config, 0.05))
    model.set_logger(Logger(None, []))
    _, callback = model._setup_learn(config.total_steps, None)
    model.collect_rollouts(model.env, callback, model.rollout_buffer, config.n_steps)
    return model


def _batch_of(buffer):
    def flat(values):
        swapped = values.swapaxes(0, 1)
        return swapped.reshape(-1, *values.shape[2:]).astype(np.float32)

    single = (flat(x)[None] for x in (buffer.log_probs, buffer.advantages, buffer.returns))
    return Batch(flat(buffer.observations).T[None], flat(buffer.actions).T[None], *single)


UPDATES = {
    "plain": {},
    "variant": {"ent_coef": 0.01, "normalize_advantage": False, "activation": "ReLU"},
    "early stop": {"target_kl": 1e-4},
}
DISCRETE = [name for name in ENVIRONMENTS if environment_setup(name, {}).task.discrete is not None]
CONTINUOUS = [name for name in ENVIRONMENTS if name not in DISCRETE]


@pytest.mark.parametrize(
    ("env_id", "kind"),
    [*in_turn(DISCRETE, ("variant", "early stop")), *in_turn(CONTINUOUS, UPDATES)],
)
def test_an_update_is_that_of_sb3(env_id, kind):
    """Same weights, rollout and order of minibatches: same weights afterwards."""
    overrides = UPDATES[kind]
    config = small_run(env_id, learning_rate=3e-3, n_epochs=4, **overrides)
    model = _sb3_model(config)
    before = _numpy_weights(model)
    discrete = env_id in DISCRETE
    stack = jax.tree.map(jnp.asarray, _stack_of(before, discrete))
    for name, value in state_dict(jax.tree.map(np.asarray, stack), 0).items():
        np.testing.assert_array_equal(value, before[name], err_msg=name)
    algorithm = Algorithm(
        4, 32, 64, 4, config.activation, config.normalize_advantage, config.target_kl is not None
    )
    batch = _batch_of(model.rollout_buffer)
    np.random.seed(5)  # noqa: NPY002  (SB3 shuffles with it)
    orders = np.stack([np.random.permutation(128) for _ in range(4)])[None].astype(np.int32)  # noqa: NPY002
    zeros = jax.tree.map(jnp.zeros_like, stack)
    knobs = _columns(config, config.learning_rate)
    after, _ = jax.jit(partial(update, algorithm))(
        stack, Adam(zeros, zeros, jnp.zeros(1)), batch, orders, knobs, knobs.learning_rate
    )
    np.random.seed(5)  # noqa: NPY002
    model.train()
    expected, got = _numpy_weights(model), state_dict(jax.tree.map(np.asarray, after), 0)
    assert set(got) == set(expected)
    for name, value in expected.items():
        np.testing.assert_allclose(got[name], value, atol=2e-6, err_msg=name)
        moved = np.abs(value - before[name]).max()
        assert moved > 0.0 or name == "log_std", name
    if config.target_kl is not None:
        assert model._n_updates < config.n_epochs


@pytest.mark.parametrize("env_id", OF_EACH_ACTION)
def test_advantages_values_and_log_probabilities_are_those_of_sb3(env_id):
    """SB3's buffer, filled from a fleet's rollout by SB3's rules, holds the same numbers."""
    config = small_run(env_id, env_arguments={"duration": 0.3}, learning_rate=1e-3)
    trainer = fleet._Trainer(kind_of(config), [config], None)
    learner, knobs, params = trainer._new(), trainer._knobs(), trainer._params
    program = trainer._program
    _, steps = jax.jit(program._collect)(learner, learner.keys, params)
    _, outcome, observed, observed_after = jax.jit(program._again)(steps, params)
    told = (observed, observed_after)
    batch = jax.jit(program._batch)(learner.stack, knobs, steps, outcome, told)
    ended = np.asarray(steps.terminated | steps.truncated)[:, 0]
    assert ended.any()
    model = _sb3_model(config)
    weights = state_dict(jax.tree.map(np.asarray, learner.stack), 0)
    model.policy.load_state_dict(
        {k: model.policy.state_dict()[k].new_tensor(v) for k, v in weights.items()}
    )
    _check_against_buffer(model, config, steps, outcome, observed, observed_after, ended, batch)


def _check_against_buffer(model, config, steps, outcome, observed, observed_after, ended, batch):
    import torch

    def tensor(values):
        return torch.as_tensor(np.array(values, dtype=np.float32))

    buffer = model.rollout_buffer
    buffer.reset()
    gamma = config.discount(model.env.unwrapped.vector_env.unwrapped.setup.timing.control_period)
    buffer.gamma = gamma
    starts = np.ones(config.n_envs, dtype=bool)
    with torch.no_grad():
        for t in range(config.n_steps):
            observation = tensor(observed[:, t, 0].T)
            action = tensor(steps.action[t, 0].T)
            taken = action.flatten() if config.env_id == "IntegCartPole-v0" else action
            values, log_prob, _ = model.policy.evaluate_actions(observation, taken)
            reward = np.asarray(outcome.reward)[t, 0] * np.float32(config.reward_scale)
            terminal = model.policy.predict_values(tensor(observed_after[:, t, 0].T)).flatten()
            cut = np.asarray(steps.truncated & ~steps.terminated)[t, 0]
            reward = reward + gamma * terminal.numpy() * cut
            buffer.add(observation.numpy(), action.numpy(), reward, starts, values, log_prob)
            starts = ended[t]
        last = model.policy.predict_values(tensor(observed_after[:, -1, 0].T))
    buffer.compute_returns_and_advantage(last, starts)
    expected = _batch_of(buffer)
    for name in Batch._fields:
        np.testing.assert_allclose(
            getattr(batch, name), getattr(expected, name), rtol=1e-4, atol=2e-5, err_msg=name
        )


def test_initial_weights_are_orthogonal_with_sb3s_gains():
    stack = initial_stack([0, 1], (3, 64, 64), 2, [0.5, 0.25])
    model = PPO("MlpPolicy", gym.make("CartPole-v1"), device="cpu")
    for name, value in model.policy.state_dict().items():
        value = value.numpy()
        if name.endswith("weight"):
            gain = np.linalg.norm(value, 2)
            mine = state_dict(stack, 0)[name]
            np.testing.assert_allclose(np.linalg.norm(mine, 2), gain, rtol=1e-4, err_msg=name)
            rows = mine if mine.shape[0] <= mine.shape[1] else mine.T
            np.testing.assert_allclose(rows @ rows.T, gain**2 * np.eye(len(rows)), atol=1e-4)
        else:
            assert not value.any()
            assert not state_dict(stack, 0)[name].any()
    np.testing.assert_array_equal(stack.log_std, [[0.5, 0.5], [0.25, 0.25]])
    assert not np.array_equal(stack.weights[0][0], stack.weights[0][1])
    assert orthogonal(np.random.default_rng(0), 2, 5, 1.0).shape == (2, 5)


def test_orders_are_permutations():
    for size in (32, 30):
        algorithm = Algorithm(1, size, 2, 3, "Tanh", True, False)
        orders = permutations(algorithm, jax.random.split(jax.random.key(0), 2))
        assert orders.shape == (2, 3, size)
        np.testing.assert_array_equal(
            np.sort(orders, axis=-1), np.broadcast_to(np.arange(size), orders.shape)
        )
        assert len({tuple(order) for order in np.asarray(orders).reshape(6, size)}) == 6


def _pair(env_id):
    configs = [
        small_run(env_id, seed=seed, env_arguments={"mass": mass}, learning_rate=rate)
        for seed, mass, rate in ((0, 1.0, 1e-3), (1, 1.5, 2e-3))
    ]
    return configs, train_chunk(configs)


@pytest.fixture(scope="module")
def pair():
    """Two runs that differ in all that may differ within a chunk, and their outcomes."""
    return _pair("IntegPendulum-v0")


def test_policies_learn_the_same_in_turn_and_at_once():
    lossy = {"latency_jitter": 0.1, "hold_probability": 0.2}
    given = {"learning_rate": 3e-3, "target_kl": 1e-4, "env_arguments": lossy}
    configs = [small_run(seed=seed, **given) for seed in range(2)]
    trainer = fleet._Trainer(kind_of(configs[0]), configs, None)
    env, algorithm = trainer._program.env, trainer._program.algorithm
    stacks = []
    for one_by_one in (True, False):
        program = FleetProgram(env, algorithm, in_turn=one_by_one)
        learner = trainer._new()
        for _ in range(2):
            learner, _ = program.iterate(learner, trainer._knobs(), trainer._params)
        stacks.append(learner.stack)
    begun = trainer._new().stack
    for one, other, start in zip(*(jax.tree.leaves(s) for s in (*stacks, begun)), strict=True):
        np.testing.assert_allclose(one, other, atol=2e-6)
        assert np.abs(one - start).max() > 1e-4


def test_one_stage_is_a_whole_run(pair):
    configs, outcomes = pair
    for staged, outcome in zip(train_in_stages([configs]), outcomes, strict=True):
        assert staged.last_episodes == outcome.last_episodes
        for name, value in outcome.weights.items():
            np.testing.assert_array_equal(staged.weights[name], value, err_msg=name)


def test_stages_go_on_where_the_stage_before_ended(pair):
    """The first stage is the beginning of a whole run, and the next moves on from its weights."""
    config = pair[0][0]
    rollouts = kind_of(config).rollouts
    assert rollouts >= 2
    heavier = replace(config, env_arguments={**config.env_arguments, "mass": 3.0})
    (one,), (other,) = (train_in_stages([[config], [second]]) for second in (config, heavier))
    begun = fleet._Trainer(kind_of(config), [config])
    learner = begun.train(None, round(rollouts / 2))
    on = fleet._Trainer(kind_of(heavier), [heavier])
    learner = on.train(None, rollouts - round(rollouts / 2), learner)
    assert int(learner.iteration) == rollouts
    for name, value in on.outcomes(learner)[0].weights.items():
        np.testing.assert_array_equal(other.weights[name], value, err_msg=name)
    assert any(not np.array_equal(one.weights[name], other.weights[name]) for name in one.weights)
    with pytest.raises(ValueError, match="no stage"):
        train_in_stages([])
    with pytest.raises(ValueError, match="some would have none"):
        train_in_stages([[config]] * (rollouts + 1))


@pytest.mark.parametrize("env_id", OF_EACH_ACTION)
def test_files_open_everywhere_and_act_the_same(env_id, pair, tmp_path):
    configs, outcomes = pair if env_id == "IntegPendulum-v0" else _pair(env_id)
    config, outcome = configs[1], outcomes[1]
    trained = write_outcome(config, outcome, tmp_path)
    model = PPO.load(trained.policy, device="cpu")
    policy, card = read_trained(trained.policy)
    weights, _ = read_trained(tmp_path / "policy.safetensors")
    assert policy.content_hash == weights.content_hash == trained.content_hash
    assert card["trainer"] == "fleet"
    assert card["steps"] == config.rounded_steps == model.num_timesteps
    observations = model.observation_space.sample()[None] * 0.1
    observations = np.concatenate([observations * k for k in np.linspace(-2, 2, 50)])
    expected, _ = model.predict(observations, deterministic=True)
    np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)
    np.testing.assert_array_equal(policy.act(observations), weights.act(observations))
    for name, value in _numpy_weights(model).items():
        np.testing.assert_array_equal(value, outcome.weights[name])


def test_evidence_of_training_episodes(tmp_path):
    config = small_run(env_arguments={"duration": 0.5}, total_steps=512, trace_every=3)
    context = EpisodeContext("run", "cell", phase="training", trace_every=3, training_seed=0)
    places = [
        TrainingEvidence(tmp_path, f"batch-{k}", replace(context, cell=f"c{k}")) for k in (0, 1)
    ]
    configs = [config, replace(config, seed=1)]
    outcomes = train_chunk(configs, places)
    store = EvidenceStore(tmp_path)
    assert store.verify() == []
    records = [r for r in store.records() if r["cell"] == "c0"]
    assert len(records) == store.count() // 2 == 4 * (128 // 10)
    assert [r["episode_index"] for r in records] == list(range(len(records)))
    assert {r["length"] for r in records} == {10}
    assert {r["float_width"] for r in records} == {32}
    last = [r["return"] for r in records][-100:]
    np.testing.assert_allclose(np.mean(last), outcomes[0].last_episodes["return_mean"], rtol=1e-5)
    for record in records:
        traced = record["episode_index"] % 3 == 0
        assert bool(record.trace) == traced
        if traced:
            np.testing.assert_allclose(record["reward"].sum(), record["return"], rtol=1e-9)
    _replay(records[0], config)
    balance = (
        records[5]["energy_end"] - records[5]["energy_start"] - records[5]["work_total"]
        + records[5]["dissipated_total"] + records[5]["clip_loss_total"]
    )  # fmt: skip
    np.testing.assert_allclose(balance, records[5]["energy_residual_total"], atol=1e-4)


def _replay(record, config):
    """The recorded commands, given to the single environment, lead to the recorded states."""
    env = gym.make(config.env_id, **config.env_arguments)
    env.reset(options={"state": record["initial_state"]})
    names = record.trace
    states = np.stack([names["theta"], names["theta_dot"]], axis=1)
    np.testing.assert_allclose(states[0], record["initial_state"], rtol=1e-6)
    for command, state in zip(names["torque_commanded"], states[1:], strict=True):
        env.step(np.array([command], dtype=np.float32))
        np.testing.assert_allclose(env.unwrapped.state, state, rtol=1e-4, atol=1e-4)


@pytest.mark.slow
def test_a_policy_can_be_trained_on_an_engine_in_jax(tmp_path):
    """Without damping MJX's Euler is symplectic Euler: the policy is that of our integrator."""
    needs("mjx")
    theirs = {"engine": "mjx", "integrator": "Euler", "duration": 0.5}
    ours = {"integrator": "symplectic_euler", "duration": 0.5}
    configs = [small_run(total_steps=128, n_epochs=1, env_arguments=own) for own in (theirs, ours)]
    context = EpisodeContext("run", "cell", phase="training", training_seed=0)
    (mjx,) = train_chunk(configs[:1], [TrainingEvidence(tmp_path, "batch", context)])
    (native,) = train_chunk(configs[1:])
    for name, value in native.weights.items():
        np.testing.assert_allclose(mjx.weights[name], value, atol=1e-5, err_msg=name)
    told = {(r["engine"], r["solver_status"]) for r in EvidenceStore(tmp_path).records()}
    assert told == {("mjx", "not_reported")}
    policy = write_outcome(configs[0], mjx, tmp_path)
    assert policy.card["discretization"]["engine"] == "mjx"


BOTH = """
import jax, os, sys, torch, stable_baselines3
from pathlib import Path
from integ_gym import train_fleet
from integ_gym.cli import main
from integ_gym.train.ppo import PPOConfig

def configured():
    return {n: jax.config.values[n] for n in jax.config.values}, dict(os.environ)

if __name__ == "__main__":
    folder, (values, environ) = Path(sys.argv[1]), configured()
    small = dict(n_envs=4, n_steps=32, batch_size=64, n_epochs=1, total_steps=128, net_arch=(8,))
    small["env_arguments"] = {"integrator": "rk4", "dt": 0.05}
    config = PPOConfig.of("IntegPendulum-v0", seed=0, **small)
    train_fleet([config], [folder / "worker"], progress=False, workers=1)
    after, now = configured()
    assert after == values
    assert {k for k in now if now[k] != environ.get(k)} <= {"TORCHINDUCTOR_CACHE_DIR"}
    flags = "--integrator rk4 --dt 0.05 --n-envs 4 --n-steps 32 --batch-size 64 --n-epochs 1"
    flags += " --total-steps 128 --net-arch 8 --no-progress"
    sys.exit(main(["train", "--trainer", "fleet", *flags.split(), "--out", str(folder / "here")]))
"""


@pytest.mark.slow
def test_workers_leave_this_process_as_it_was_and_train_what_the_command_trains_in_its_own(
    tmp_path,
):
    script = tmp_path / "both.py"
    script.write_text(BOTH)
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    names = ("worker", "here")
    weights = [(tmp_path / name / "policy.safetensors").read_bytes() for name in names]
    assert weights[0] == weights[1]
    cards = [read_trained(tmp_path / name / "policy.zip")[1] for name in names]
    assert [card["seed"] for card in cards] == [0, 0]
    assert set(cards[0]) == set(cards[1])


def test_safetensors_that_are_none_are_refused(tmp_path):
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(b"nothing")
    with pytest.raises(PolicyFileError, match="not a readable safetensors file"):
        read_safetensors(damaged)
    damaged.write_bytes(save({"a": np.zeros(1)}, {"format": "other"}))
    with pytest.raises(PolicyFileError, match="has format 'other'"):
        read_safetensors(damaged)
    damaged.write_bytes(save({"a": np.zeros(1)}, {"format": FORMAT, "activation": "Tanh"}))
    with pytest.raises(PolicyFileError, match="does not describe a policy"):
        read_safetensors(damaged)


def test_training_episodes_that_end_early_come_out_again(tmp_path):
    """Several controls, and times between the seconds that float32 holds."""
    config = small_run("IntegQuadrotor-v0", total_steps=1024, trace_every=1)
    context = EpisodeContext("run", "cell", phase="training", trace_every=1, training_seed=0)
    train_chunk([config], [TrainingEvidence(tmp_path, "batch", context)])
    named = list(EvidenceStore(tmp_path).named_records())
    assert len({record["length"] for _, record in named}) > 3
    for name, record in named:
        assert {"left_thrust_commanded", "right_thrust_applied"} <= set(record.trace)
        assert list(recompute(record, name)) == []
