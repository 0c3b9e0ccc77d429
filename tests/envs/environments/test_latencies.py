"""Observations and commands that are late, or lost, in every form of an environment."""

from collections import deque
from statistics import NormalDist

import gymnasium as gym
import numpy as np
import pytest
from sameness import assert_same

import integ_gym
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.evidence.replaying import replay
from integ_gym.evidence.store import EvidenceStore

COMMON = {"integrator": "rk4", "dt": 0.0125, "control_period": 0.05, "duration": 1.5}
LATENCIES = [0.05, 0.075, 0.1125]
LOST = {"hold_probability": 0.3}
DRAWN = [
    LOST, {"latency_jitter": 0.025}, {"action_latency": 0.0375, "latency_jitter": 0.1125, **LOST},
]  # fmt: skip


class Late(gym.Wrapper):
    """Steps one that decides at every integration step, and shows what was so long ago."""

    def __init__(self, env, substeps, late):
        super().__init__(env)
        self.substeps, self.late = substeps, late

    def reset(self, **given):
        observation, info = self.env.reset(**given)
        self.seen = deque([observation] * (self.late + 1), self.late + 1)
        return observation, info

    def step(self, action):
        for _ in range(self.substeps):
            observation, _, _, truncated, info = self.env.step(action)
            self.seen.append(observation)
        return self.seen[0], 0.0, False, truncated, info


def _actions(steps):
    return np.random.default_rng(0).uniform(-2.0, 2.0, (steps, 1)).astype(np.float32)


@pytest.mark.parametrize("latency", LATENCIES)
def test_observations_are_those_of_an_independent_wrapper(latency):
    env = gym.make("IntegPendulum-v0", **COMMON, observation_latency=latency)
    fine = gym.make("IntegPendulum-v0", **{**COMMON, "control_period": 0.0125})
    wrapped = Late(fine, 4, round(latency / 0.0125))
    assert (env.reset(seed=3)[0] == wrapped.reset(seed=3)[0]).all()
    for k, action in enumerate(_actions(25)):
        own, _, _, _, info = env.step(action)
        assert (own == wrapped.step(action)[0]).all()
        assert info["sensor_time"] == pytest.approx(max(0.0, (k + 1) * 0.05 - latency))


class Wire:
    """What becomes of commands, by the rule as it is written: the newest that has arrived acts."""

    def __init__(self, fine, actions):
        self.fine, self.actions, self.arrived = fine, actions, []

    def step(self, k, held, steps):
        """Decision k, whose command arrives after so many integration steps."""
        if not held:
            self.arrived.append((4 * k + steps, k))
        for instant in range(4 * k, 4 * k + 4):
            there = [decision for at, decision in self.arrived if at <= instant]
            self.fine.step(self.actions[max(there)] if there else 0.0 * self.actions[0])
        return self.fine.unwrapped.state


@pytest.mark.parametrize("drawn", DRAWN)
def test_commands_arrive_as_an_independent_loop_has_them(drawn):
    """From an environment without delays that decides at every step, to the last bit."""
    env = gym.make("IntegPendulum-v0", **COMMON, **drawn)
    fine = gym.make("IntegPendulum-v0", **{**COMMON, "control_period": 0.0125})
    actions = _actions(30)
    wire, numbers = Wire(fine, actions), np.random.SeedSequence(3, spawn_key=(0x4E03, 0))
    rng = np.random.Generator(np.random.PCG64(numbers))
    env.reset(seed=3), fine.reset(seed=3)
    most = round(drawn.get("latency_jitter", 0.0) / 0.0125)
    least = round(drawn.get("action_latency", 0.0) / 0.0125)
    for k, action in enumerate(actions):
        held, late = rng.random(2)
        held, steps = held < drawn.get("hold_probability", 0.0), least + int(late * (most + 1))
        *_, info = env.step(action)
        assert info["command_held"] == held
        assert info["command_latency"] == pytest.approx(steps * 0.0125)
        assert (env.unwrapped.state == wire.step(k, held, steps)).all()


def test_what_is_drawn_has_its_probabilities_and_leaves_starts_and_noise_alone():
    given = {**COMMON, "observation_noise": 0.01}
    plain, again, lossy = (
        gym.make_vec("IntegPendulum-v0", 64, **given, **drawn)
        for drawn in ({}, {"latency_jitter": 0.0, "hold_probability": 0.0}, DRAWN[-1])
    )
    assert (plain.reset(seed=1)[0] == again.reset(seed=1)[0]).all()
    assert (plain.reset(seed=1)[0] == lossy.reset(seed=1)[0]).all()
    held, steps = [], []
    for action in _actions(100):
        actions = np.repeat(action[None], 64, axis=0)
        one, other, (*_, info) = (env.step(actions) for env in (plain, again, lossy))
        assert (one[0] == other[0]).all()
        assert "command_held" not in other[-1]
        decided = info["time"] > 0.0
        held.append(info["command_held"][decided])
        steps.append(np.round(info["command_latency"][decided] / 0.0125))
    held, steps = np.concatenate(held), np.concatenate(steps)
    far = NormalDist().inv_cdf(1.0 - 1e-6)
    assert abs(held.mean() - 0.3) < far * np.sqrt(0.21 / held.size)
    assert abs(np.corrcoef(held[64:], held[:-64])[0, 1]) < far / np.sqrt(held.size)
    counts = np.bincount(steps.astype(int))
    assert counts[:3].sum() == 0
    assert len(counts) == 3 + 10
    assert abs(counts[3:] / held.size - 0.1).max() < far * np.sqrt(0.09 / held.size)


@pytest.mark.parametrize(
    ("late", "sensor_period", "noise"),
    [
        *((DRAWN[0], 0.0375, 0.01), (DRAWN[1], None, 0.0), (DRAWN[2], None, 0.0)),
        *(({"observation_latency": seconds}, *others) for seconds, *others in (
            (0.05, 0.0375, 0.01), (0.1, 0.0875, 0.0), (0.075, None, 0.0), (0.1125, None, 0.01),
        )),
    ],
)  # fmt: skip
def test_single_vector_and_compiled_are_the_same(late, sensor_period, noise):
    given = {**COMMON, **late, "sensor_period": sensor_period, "observation_noise": noise}
    single = gym.make("IntegCartPoleSwingUp-v0", **given)
    kinds = [{}] if noise else [{}, {"compiled": True}]
    vectors = [gym.make_vec("IntegCartPoleSwingUp-v0", 3, **given, **kind) for kind in kinds]
    first, _ = single.reset(seed=5)
    for vector in vectors:
        assert (vector.reset(seed=[4, 5, 6])[0][1] == first).all()
    for action in 3.0 * _actions(28):
        own, reward, *_, info = single.step(action)
        info["observed"], info["reward"] = own, reward
        for vector in vectors:
            observation, rewards, *_, infos = vector.step(np.repeat(action[None], 3, axis=0))
            infos["observed"], infos["reward"] = observation, rewards
            assert_same({name: infos[name][1] for name in info}, info)


@pytest.mark.parametrize("drawn", DRAWN)
def test_commands_of_the_functional_environment_arrive_by_the_same_rule(drawn):
    """Of a single one, and in lanes of a mixture whose members step differently."""
    import jax

    given = {n: x for n, x in COMMON.items() if n not in ("integrator", "dt")} | drawn
    members = [{"integrator": "rk4", "dt": dt} for dt in (0.0125, 0.00625)]
    actions = _actions(25)
    with jax.enable_x64(True):
        for env in (
            integ_gym.functional.make("IntegPendulum-v0", dtype="float64", **given, **members[0]),
            integ_gym.functional.make(
                "IntegPendulum-v0", dtype="float64", **given, mixture=members
            ),
        ):
            lanes = 4 if env.shares[1:] else 1
            state = env.initial(jax.random.key(0), lanes=(lanes,))
            wires = []
            for k in range(lanes):
                coarse = not state.member or state.member[0][k] == 0
                if coarse:
                    fine = gym.make("IntegPendulum-v0", **{**COMMON, "control_period": 0.0125})
                    start = float(state.env.q[0][k]), float(state.env.v[0][k])
                    fine.reset(options={"state": start})
                    wires.append((k, Wire(fine, actions)))
            assert wires
            step = jax.jit(env.transition)
            for decision, action in enumerate(actions):
                state = step(state, np.repeat(action[None], lanes, 0), jax.random.key(decision))
                info = env.state_info(state)
                for k, wire in wires:
                    steps = round(float(info["command_latency"][k]) / 0.0125)
                    q, v = wire.step(decision, bool(info["command_held"][k]), steps)
                    assert state.env.q[0][k] == pytest.approx(q, rel=1e-9, abs=1e-9)
                    assert state.env.v[0][k] == pytest.approx(v, rel=1e-9, abs=1e-9)
            if drawn.get("hold_probability"):
                assert len({tuple(wire.arrived) for _, wire in wires}) == len(wires)


def test_the_newest_sample_that_can_have_arrived_is_shown():
    """With a sensor that samples more seldom than decisions are taken, too."""
    env = gym.make("IntegPendulum-v0", **COMMON, observation_latency=0.1, sensor_period=0.0875)
    env.reset(seed=0)
    for k in range(20):
        *_, info = env.step(np.zeros(1, np.float32))
        newest = np.floor(((k + 1) * 0.05 - 0.1) / 0.0875 + 1e-9) * 0.0875
        assert info["sensor_time"] == pytest.approx(max(0.0, newest))


def test_what_cannot_be_is_refused():
    for name in ("observation_latency", "latency_jitter"):
        with pytest.raises(ValueError, match=rf"{name}.*nearest valid: 0\.0125 or 0\.025"):
            gym.make("IntegPendulum-v0", **COMMON, **{name: 0.02})
    for wrong in (1.0, -0.1, np.nan, "often"):
        with pytest.raises(ValueError, match="`hold_probability` must be a number from 0 to below"):
            gym.make("IntegPendulum-v0", **COMMON, hold_probability=wrong)
        with pytest.raises(ValueError, match="`hold_probability` must be a number from 0 to below"):
            assert find_testbed("Hopper-v5", {"hold_probability": wrong}).home
    with pytest.raises(ValueError, match=r"sensor_period.*nearest valid: 0\.05 or 0\.1"):
        gym.make("IntegPendulum-v0", **COMMON, observation_latency=0.075, sensor_period=0.025)


@pytest.mark.slow
def test_the_truth_takes_a_step_that_divides_the_latency(tmp_path):
    panel = integ_gym.evaluate(
        lambda observation: [0.0], "IntegPendulum-v0", tmp_path,
        home={"integrator": "rk4", "dt": 0.05, "control_period": 0.05}, integrators=["rk4"],
        dts=[0.05], episodes=2, at=["truth"], workers=1,
        varied={"observation_latency": [0, 0.02], "hold_probability": [0, 0.5]},
        environment={"duration": 1.0}, progress=False, on_doubt=lambda doubt: None,
    )  # fmt: skip
    varied = {tuple(cell.environment): cell for cell in panel.cells}
    late, lossy = varied["observation_latency",], varied["hold_probability",]
    assert (late.applied.dt, lossy.applied.dt) == (0.01, 0.05)
    assert lossy.environment == {"hold_probability": 0.5}
    records = EvidenceStore(tmp_path / "evidence").named_records()
    lossy_ones = [(f, r) for f, r in records if r.arguments().get("hold_probability")]
    done = replay(lossy_ones, exact=True).settle()
    assert done.findings == []
    assert done.exact == done.records > 0


NOISY = {"observation_noise": 0.1, "integrator": "rk4"}
QUIET = {"observation_noise": 0.0, "integrator": "rk4"}
LENGTHS = ([1, 4, 2, 3], [3, 1, 5, 2])
"""Steps of episodes that follow each other, in two orders."""


def _single(**arguments):
    return gym.make("IntegPendulum-v0", **arguments)


def _vector(**arguments):
    return gym.make_vec("IntegPendulum-v0", 3, autoreset_mode="Disabled", **arguments)


def _episodes(env, lengths, seed=7):
    """Starts and observations of episodes after one seed."""
    starts, seen = [], []
    for index, length in enumerate(lengths):
        observation, _ = env.reset(seed=seed if index == 0 else None)
        starts.append(env.unwrapped.state.copy())
        observed = [observation]
        for _ in range(length):
            observed.append(env.step(np.zeros(env.action_space.shape))[0])
        seen.append(np.array(observed))
    return np.array(starts), seen


@pytest.mark.parametrize("make", [_single, _vector])
def test_starts_do_not_depend_on_noise_or_on_how_long_episodes_are(make):
    quiet, _ = _episodes(make(**QUIET), LENGTHS[0])
    for lengths in LENGTHS:
        starts, _ = _episodes(make(**NOISY), lengths)
        np.testing.assert_array_equal(starts, quiet)


def test_noise_can_be_drawn_again_without_the_episodes_before():
    env = _single(**NOISY)
    _, seen = _episodes(env, LENGTHS[0])
    assert not np.array_equal(seen[0][0], seen[1][0])
    for one, other in zip(seen, _episodes(_single(**NOISY), LENGTHS[1])[1], strict=True):
        shared = min(len(one), len(other))
        np.testing.assert_array_equal(one[:shared], other[:shared])
    again = _single(**NOISY)
    starts, _ = _episodes(_single(**QUIET), LENGTHS[0])
    first, _ = again.reset(seed=7, options={"state": starts[2], "episode": 2})
    np.testing.assert_array_equal(first, seen[2][0])
    np.testing.assert_array_equal(again.step(np.zeros(1))[0], seen[2][1])
    assert again.unwrapped.episode == 2
    for wrong in (-1, 0.5, "2"):
        with pytest.raises(ValueError, match="`episode` must be whole numbers from 0"):
            again.reset(options={"episode": wrong})


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_mixture_has_the_starts_of_a_single_discretization(noise):
    mixture = [{"integrator": "rk4"}, {"integrator": "explicit_euler"}]
    plain, _ = _episodes(_vector(**QUIET), LENGTHS[0])
    mixed = _vector(mixture=mixture, observation_noise=noise)
    starts, _ = _episodes(mixed, LENGTHS[1])
    np.testing.assert_array_equal(starts, plain)
    drawn = []
    for lengths in LENGTHS:
        env = _vector(mixture=mixture, observation_noise=noise)
        members = []
        for index, length in enumerate(lengths):
            members.append(env.reset(seed=7 if index == 0 else None)[1]["mixture_index"].tolist())
            for _ in range(length):
                env.step(np.zeros((3, 1)))
        drawn.append(members)
    assert drawn[0] == drawn[1]
