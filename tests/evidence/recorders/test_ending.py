"""What a recorder has written however its process ends, and who may record the same episodes."""

from __future__ import annotations

import signal
import subprocess
import sys
from dataclasses import replace

import gymnasium as gym
import pytest

from integ_gym.evidence.episodes.context import EpisodeContext
from integ_gym.evidence.recorders.recorder import RecordEvidence
from integ_gym.evidence.recorders.vector_recorder import RecordVectorEvidence
from integ_gym.evidence.schema.errors import EvidenceError
from integ_gym.evidence.store.store import EvidenceStore

RECORDING = """
import multiprocessing, os, signal, sys
import gymnasium as gym
import integ_gym
from integ_gym import EpisodeContext, RecordEvidence

def record(directory, episodes=200):
    env = gym.make("IntegPendulum-v0", duration=0.1)
    env = RecordEvidence(env, directory, EpisodeContext("run", "cell", trace_every=50))
    for seed in range(episodes):
        env.reset(seed=seed)
        ended = False
        while not ended:
            *_, terminated, truncated, _ = env.step(env.action_space.sample())
            ended = terminated or truncated

if __name__ == "__main__":
"""

ENDINGS = {
    "script": "record(sys.argv[1])",
    "exit": "record(sys.argv[1]); sys.exit(3)",
    "error": "record(sys.argv[1]); raise ValueError('the script is wrong')",
    "child": "p = multiprocessing.get_context('spawn').Process(target=record, args=sys.argv[1:])\n"
    "    p.start(); p.join()",
    "fork": "record(sys.argv[1]); os.fork() or sys.exit(); os.wait()",
}


def _run(tmp_path, ending):
    script = tmp_path / "script.py"
    script.write_text(f"{RECORDING}    {ending}\n")
    command = [sys.executable, str(script), str(tmp_path / "evidence")]
    return subprocess.run(command, capture_output=True, text=True)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_process_that_ends_without_close_loses_nothing(ending, tmp_path):
    done = _run(tmp_path, ENDINGS[ending])
    assert done.returncode == {"exit": 3, "error": 1}.get(ending, 0), done.stderr
    store = EvidenceStore(tmp_path / "evidence")
    assert sorted(r["seed"] for r in store.records(trace=False)) == list(range(200))
    assert store.verify() == []
    assert {file.suffix for file in store.directory.iterdir()} == {".parquet"}


def test_a_process_that_is_killed_loses_less_than_a_batch(tmp_path):
    done = _run(tmp_path, "record(sys.argv[1], 250); os.kill(os.getpid(), signal.SIGKILL)")
    assert done.returncode == -signal.SIGKILL
    store = EvidenceStore(tmp_path / "evidence")
    assert sorted(r["seed"] for r in store.records(trace=False)) == list(range(200))
    again = EpisodeContext("run", "cell", first_episode=200)
    RecordEvidence(gym.make("IntegPendulum-v0"), store, again).close()


def test_what_waits_in_memory_is_bounded(tmp_path, context, play):
    env = gym.make("IntegPendulum-v0", duration=0.1)
    env = RecordEvidence(env, tmp_path, context, commit_every=7)
    for episode in range(20):
        play(env, [episode])
        assert len(env.summaries()["episode_index"]) == (episode + 1) % 7
    env.close()
    assert [len(r) for r in (EvidenceStore(tmp_path).batches(),)] == [3]
    assert EvidenceStore(tmp_path).count() == 20


def test_lanes_that_end_together_are_committed_together(tmp_path, context):
    env = gym.make_vec("IntegPendulum-v0", num_envs=4, duration=0.1)
    others = [replace(context, cell=f"cell {k}") for k in range(2)]
    env = RecordVectorEvidence(env, tmp_path, others, commit_every=4)
    env.reset(seed=0)
    for _ in range(9):
        env.step(env.action_space.sample())
    assert EvidenceStore(tmp_path).count() == 12
    env.close()
    assert len(EvidenceStore(tmp_path).batches()) == 3


def _made(directory, context):
    return lambda: RecordEvidence(gym.make("IntegPendulum-v0", duration=0.1), directory, context)


def test_two_recorders_of_one_context_are_refused_at_construction(tmp_path, context):
    with pytest.raises(EvidenceError, match=r"give each environment of a vector its own `cell`"):
        gym.vector.SyncVectorEnv([_made(tmp_path, context)] * 2)


def test_two_recorders_of_one_context_in_two_processes_are_refused(tmp_path, context):
    script = (
        "import gymnasium as gym, integ_gym, sys\n"
        "from integ_gym import EpisodeContext, RecordEvidence\n"
        "context = EpisodeContext('run', 'cell', policy_id='random')\n"
        "RecordEvidence(gym.make('IntegPendulum-v0'), sys.argv[1], context)\n"
    )
    env = _made(tmp_path, context)()
    command = [sys.executable, "-c", script, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert "another recorder is open" in done.stderr
    env.close()
    subprocess.run(command, check=True)


def test_recorders_with_contexts_of_their_own_lose_nothing(tmp_path, context):
    made = [_made(tmp_path, replace(context, cell=f"environment {k}")) for k in range(3)]
    env = gym.vector.SyncVectorEnv(made)
    env.reset(seed=0)
    for _ in range(5):
        env.step(env.action_space.sample())
    env.close()
    cells = [record["cell"] for record in EvidenceStore(tmp_path).records(trace=False)]
    assert sorted(set(cells)) == ["environment 0", "environment 1", "environment 2"]
    assert len(cells) == 6


def test_episodes_that_are_recorded_are_refused_at_construction(tmp_path, context, play):
    env = _made(tmp_path, context)()
    play(env, range(3))
    env.close()
    with pytest.raises(EvidenceError, match=r"episodes 0 to 2 .* first_episode=3"):
        _made(tmp_path, context)()
    env = _made(tmp_path, replace(context, first_episode=3))()
    play(env, [3])
    env.close()
    assert EvidenceStore(tmp_path).verify() == []


def test_a_recorder_that_leaves_writing_to_others_holds_nothing(tmp_path, context):
    for _ in range(2):
        env = gym.make("IntegPendulum-v0")
        RecordEvidence(env, tmp_path / "store", context, commit_on_close=False)
    assert not (tmp_path / "store").exists()


def test_a_batch_of_less_than_one_is_refused(tmp_path, context):
    with pytest.raises(ValueError, match="`commit_every` must be 1 or above, or None, got 0"):
        RecordEvidence(gym.make("IntegPendulum-v0"), tmp_path, context, commit_every=0)
