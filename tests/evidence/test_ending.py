"""What a recorder has written however its process ends, and who may record the same episodes."""

from __future__ import annotations

import copy
import pickle
import signal
import subprocess
import sys
from dataclasses import replace

import gymnasium as gym
import pytest
from recording import CONTEXT, PENDULUM, made, play, recorded

from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.schema import EvidenceError
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence

SHORT = {"duration": 0.1}


@pytest.mark.parametrize("way", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_recorder_is_not_copied(way, tmp_path):
    vector = RecordVectorEvidence(gym.make_vec(PENDULUM, 2), tmp_path / "vector", CONTEXT)
    for env in (made(tmp_path), vector):
        with pytest.raises(TypeError, match="copy the environment that it records"):
            way(env)
        env.close()


RECORDING = """
import multiprocessing, os, signal, sys
import gymnasium as gym
import integ_gym
from integ_gym import EpisodeContext, RecordEvidence

kept = []

def record(directory, episodes=200):
    env = gym.make("IntegPendulum-v0", duration=0.1)
    env = RecordEvidence(env, directory, EpisodeContext("run", "cell", trace_every=50))
    kept.append(env)
    for seed in range(episodes):
        env.reset(seed=seed)
        ended = False
        while not ended:
            *_, terminated, truncated, _ = env.step(env.action_space.sample())
            ended = terminated or truncated

if __name__ == "__main__":
"""

ENDINGS = {
    "error": "record(sys.argv[1]); raise ValueError('the script is wrong')",
    "child": "p = multiprocessing.get_context('spawn').Process(target=record, args=sys.argv[1:])\n"
    "    p.start(); p.join()",
    "fork": "record(sys.argv[1]); os.fork() or sys.exit(); os.wait()",
    "killed": "record(sys.argv[1], 250); os.kill(os.getpid(), signal.SIGKILL)",
}


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_process_that_ends_without_close_loses_nothing(ending, tmp_path):
    """And one that is killed less than a batch."""
    script = tmp_path / "script.py"
    script.write_text(f"{RECORDING}    {ENDINGS[ending]}\n")
    command = [sys.executable, str(script), str(tmp_path / "evidence")]
    done = subprocess.run(command, capture_output=True, text=True)
    expected = {"error": 1, "killed": -signal.SIGKILL}.get(ending, 0)
    assert done.returncode == expected, done.stderr
    store = EvidenceStore(tmp_path / "evidence")
    assert sorted(r["seed"] for r in store.records(trace=False)) == list(range(200))
    assert store.verify() == []
    left = {file.suffix for file in store.directory.iterdir()}
    assert left == {".parquet"} or ending == "killed"
    made(store.directory, replace(CONTEXT, policy_id="", first_episode=200)).close()


def test_what_waits_in_memory_is_bounded(tmp_path):
    env = RecordEvidence(gym.make(PENDULUM, **SHORT), tmp_path, CONTEXT, commit_every=7)
    for episode in range(20):
        play(env, [episode])
        assert len(env.summaries()["episode_index"]) == (episode + 1) % 7
    env.close()
    assert len(EvidenceStore(tmp_path).batches()) == 3
    assert EvidenceStore(tmp_path).count() == 20
    with pytest.raises(ValueError, match="`commit_every` must be 1 or above, or None, got 0"):
        RecordEvidence(gym.make(PENDULUM), tmp_path, CONTEXT, commit_every=0)


def _made(directory, context=CONTEXT):
    return lambda: made(directory, context, **SHORT)


def test_two_recorders_of_one_context_are_refused_in_one_process_and_in_two(tmp_path):
    with pytest.raises(EvidenceError, match=r"give each environment of a vector its own `cell`"):
        gym.vector.SyncVectorEnv([_made(tmp_path)] * 2)
    script = (
        "import gymnasium as gym, integ_gym, sys\n"
        "from integ_gym import EpisodeContext, RecordEvidence\n"
        "context = EpisodeContext('run', 'cell', policy_id='random')\n"
        "RecordEvidence(gym.make('IntegPendulum-v0'), sys.argv[1], context)\n"
    )
    env = made(tmp_path)
    command = [sys.executable, "-c", script, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert "another recorder is open" in done.stderr
    env.close()
    made(tmp_path).close()


@pytest.mark.parametrize("firsts", [(0, 3), (3, 0)])
def test_two_counts_of_one_context_would_meet(firsts, tmp_path):
    """Nobody knows how far a count goes; without a refusal both write the same records."""
    first, second = (replace(CONTEXT, first_episode=first) for first in firsts)
    env = made(tmp_path, first, **SHORT)
    with pytest.raises(EvidenceError, match=rf"another .* open .* from episode {firsts[0]} on"):
        made(tmp_path, second)
    play(env, range(5))
    env.close()
    assert EvidenceStore(tmp_path).verify() == []
    assert EvidenceStore(tmp_path).count() == 5


def test_a_count_that_would_come_to_what_is_recorded_is_refused(tmp_path):
    """The message tells the first episode that is free behind all batches."""
    env = RecordEvidence(gym.make(PENDULUM, **SHORT), tmp_path,
                         replace(CONTEXT, first_episode=3), commit_every=2)  # fmt: skip
    play(env, range(5))
    env.close()
    assert len(EvidenceStore(tmp_path).files()) == 3
    for first in (0, 4, 7):
        with pytest.raises(EvidenceError, match=r"holds .* first_episode=8,"):
            made(tmp_path, replace(CONTEXT, first_episode=first))
    store = recorded(tmp_path, [8], replace(CONTEXT, first_episode=8), **SHORT)
    assert store.verify() == []


def test_what_was_committed_by_another_name_or_beside_others_is_known(tmp_path):
    env = made(tmp_path, **SHORT)
    play(env, range(2))
    env.commit("mine")
    env.close()
    with pytest.raises(EvidenceError, match=r"mine.parquet holds episodes 0 to 1 .*_episode=2,"):
        made(tmp_path)
    pair = [replace(CONTEXT, cell=name) for name in ("a", "b")]
    vector = RecordVectorEvidence(gym.make_vec(PENDULUM, num_envs=2, **SHORT), tmp_path, pair)
    vector.reset(seed=0)
    for _ in range(2):
        vector.step(vector.action_space.sample())
    vector.close()
    for one in pair:
        with pytest.raises(EvidenceError, match=r"holds episodes 0 to 0 .* first_episode=1,"):
            made(tmp_path, one)
    made(tmp_path, replace(CONTEXT, cell="c")).close()


def _paired(directory, episodes):
    env = gym.make_vec(PENDULUM, num_envs=len(episodes), **SHORT)
    env = RecordVectorEvidence(env, directory, CONTEXT, episodes=episodes)
    env.reset(seed=list(episodes))
    return env


def _played(env):
    while not env.recorded.all():
        env.step(env.action_space.sample())
    env.close()


def test_paired_episodes_are_refused_where_they_are_the_same(tmp_path):
    """And nowhere else: their least and greatest say nothing of those in between."""
    even, odd = _paired(tmp_path, [0, 2, 4]), _paired(tmp_path, [5, 1, 3])
    for wanted, same in (([9, 4], 4), ([1, 6], 1)):
        with pytest.raises(EvidenceError, match=rf"another .* open .*, episode {same};"):
            _paired(tmp_path, wanted)
    with pytest.raises(EvidenceError, match="another recorder is open"):
        made(tmp_path, replace(CONTEXT, first_episode=5))
    later = made(tmp_path, replace(CONTEXT, first_episode=6))
    with pytest.raises(EvidenceError, match="from episode 6 on"):
        even.assign([7, 8, 9])
    later.close()
    _played(even)
    with pytest.raises(EvidenceError, match=r"holds episodes 0 to 4 .*; give other episodes,"):
        odd.assign([7, 2, 9])
    _played(odd)
    assert EvidenceStore(tmp_path).verify() == []
    assert sorted(r["episode_index"] for r in EvidenceStore(tmp_path).records()) == [*range(6)]
    _played(_paired(tmp_path, [6, 7]))


def test_a_recorder_that_nobody_has_any_more_holds_nothing_and_loses_nothing(tmp_path):
    env = made(tmp_path, **SHORT)
    play(env, range(2))
    del env
    assert EvidenceStore(tmp_path).count() == 2
    made(tmp_path, replace(CONTEXT, first_episode=2)).close()
    assert [file.suffix for file in tmp_path.iterdir()] == [".parquet"]
