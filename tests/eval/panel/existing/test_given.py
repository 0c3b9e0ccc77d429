"""Policies given as functions, objects and models, and the same policy in several files."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from house import ROOT
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize
from swaying import MONOPED
from torch import nn

import integ_gym
from integ_gym.cli import main
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.eval.panel import evaluate as panel_evaluate
from integ_gym.eval.panel.cells import Cell
from integ_gym.eval.panel.episodes import Subject
from integ_gym.eval.panel.policies import given_policy, read_existing
from integ_gym.eval.panel.run_directory import RunDirectory
from integ_gym.eval.panel.spec import PanelSpec
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.baselines import make_baseline
from integ_gym.train.policy import MlpPolicy, start_acting

PENDULUM = "IntegPendulum-v0"


def swing(observation):
    return [0.5 * observation[1]]


def lean(observation):
    return [-observation[1]]


class Predicting:
    def predict(self, observations):
        assert observations.ndim == 2
        return 0.5 * observations[:, 1:2], {"entropy": 0.0}


class Deterministic:
    def predict(self, observations, state=None, deterministic=False):
        assert deterministic
        return 0.5 * observations[:, 1:2], state


class Known:
    policy_id, content_hash = "known", "0" * 64

    def act(self, observations):
        return (0.5 * observations[:, 1:2]).astype(np.float32)


def test_all_ways_to_ask_give_the_same_actions():
    observations = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)
    found = [
        given_policy(one, PENDULUM, {}).policy for one in (swing, Predicting(), Deterministic())
    ]
    for policy in found:
        np.testing.assert_allclose(policy.act(observations), 0.5 * observations[:, 1:2])
    assert len({policy.content_hash for policy in found}) == 1
    assert [policy.policy_id for policy in found] == ["swing", "Predicting", "Deterministic"]
    known = given_policy(Known(), PENDULUM, {}).policy
    assert (known.policy_id, known.content_hash) == ("known", "0" * 64)
    np.testing.assert_allclose(known.act(observations), 0.5 * observations[:, 1:2])


def test_another_behaviour_is_another_policy():
    hashes = {given_policy(one, PENDULUM, {}).policy.content_hash for one in (swing, lambda o: [0])}
    assert len(hashes) == 2


def test_a_model_is_read_as_its_file(tmp_path):
    model = SAC("MlpPolicy", "Pendulum-v1", seed=0, buffer_size=10, device="cpu")
    model.save(tmp_path / "model.zip")
    policy = given_policy(model, PENDULUM, {}).policy
    assert isinstance(policy, MlpPolicy)
    read = read_existing(tmp_path / "model.zip", PENDULUM, {}).policy
    assert policy.content_hash == read.content_hash


def _noisy(observation, random=np.random.default_rng(0)):  # noqa: B008
    return random.normal(size=1)


def _broken(observation):
    raise KeyError("weights")


@pytest.mark.parametrize(
    ("given", "fragment"),
    [
        (3, "must be callable or have `predict`, got int"),
        (_noisy, "gives other actions when it is asked again"),
        (_broken, "raised KeyError: 'weights'; give a function from one observation"),
        (os.getcwd, r"policy '\w+' raised TypeError: .*; give a function from one observation"),
        (lambda observation: [0.0, 1.0], "where 34 actions|where 136 actions"),
        (
            lambda observation: ["left"],
            r"expected; give one action of shape \(1,\) for one observation",
        ),
        ("no_such_module:f", "cannot load policy 'no_such_module:f': ModuleNotFoundError"),
    ],
)
def test_what_is_no_policy_is_refused(given, fragment):
    with pytest.raises((TypeError, ValueError), match=fragment):
        given_policy(given, PENDULUM, {})


def test_discrete_actions_are_whole_numbers():
    cart_pole = "IntegCartPole-v0"
    policy = given_policy(lambda o: float(o[2] > 0), cart_pole, {}).policy
    assert policy.act(np.array([[0, 0, 1, 0], [0, 0, -1, 0]])).tolist() == [1, 0]
    with pytest.raises(ValueError, match="where a whole number was expected"):
        given_policy(lambda o: 0.5, cart_pole, {})


def test_a_function_of_a_module_is_judged_by_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "my_policies", raising=False)
    (tmp_path / "my_policies.py").write_text("def still(observation):\n    return [0.0]\n")
    monkeypatch.syspath_prepend(tmp_path)
    out = str(tmp_path / "out")
    chosen = ["--integrator=rk4", "--dt=0.05", "--episodes=2", "--env-arg", "duration=1.0"]
    command = ["evaluate", "--policy", "my_policies:still", "--env", PENDULUM, "--out", out]
    assert main([*command, *chosen, "--workers", "1", "--no-progress"]) == 0
    printed = capsys.readouterr()
    assert printed.err.startswith("home: unknown (")
    assert "home unknown, so what is lost is unknown" in " ".join(printed.out.split())
    panel = integ_gym.read_panel(Path(out) / "panel.json")
    assert panel.row("still").policies[0].file is None


UNGUARDED = """
import integ_gym
from stub import still
integ_gym.evaluate(still, "IntegPendulum-v0", "out", workers=2, progress=False)
"""


def test_a_script_without_a_guard_is_told_so_before_anything_is_created(tmp_path):
    (tmp_path / "stub.py").write_text("def still(observation):\n    return [0.0]\n")
    (tmp_path / "script.py").write_text(UNGUARDED)
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True,
        check=False, env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert "SpawnError" in done.stderr
    assert "workers=1" in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_model_that_remembers_does_so_from_the_start_of_an_episode():
    model = RecurrentPPO("MlpLstmPolicy", "Pendulum-v1", n_steps=8, device="cpu", seed=0)
    policy = given_policy(model, "IntegPendulum-v0", {}, "stock").policy
    seen = np.random.default_rng(0).normal(size=(4, 5, 3)).astype(np.float32)
    state, expected = None, []
    for observations in seen:
        actions, state = model.predict(observations, state, deterministic=True)
        expected.append(actions)
    assert not np.array_equal(expected[1], model.predict(seen[1], deterministic=True)[0])
    for _ in range(2):
        act = start_acting(policy)
        assert np.array_equal([act(observations) for observations in seen], expected)


def test_a_model_that_cannot_be_read_is_asked_with_its_statistics():
    env = VecNormalize(make_vec_env("Pendulum-v1", 1))
    model = PPO(
        "MlpPolicy", env, n_steps=8, batch_size=8, device="cpu",
        policy_kwargs={"activation_fn": nn.PReLU},
    )  # fmt: skip
    env.obs_rms.mean[:], env.obs_rms.var[:] = 0.5, 4.0
    policy = given_policy(model, "IntegPendulum-v0", {}, "stock").policy
    seen = np.array([[1.0, 0.0, 3.0]], dtype=np.float32)
    expected = model.predict(env.normalize_obs(seen), deterministic=True)[0]
    np.testing.assert_allclose(policy.act(seen), expected, atol=1e-6)


WITHOUT_JAX = """
import sys
sys.modules["jax"] = None
import integ_gym
integ_gym.evaluate(
    lambda seen: [0.0], "InvertedPendulum-v5", "out", home="stock", integrators=["Euler"],
    dts=[0.02], episodes=1, workers=1, progress=False,
)
"""


@pytest.mark.slow
def test_an_evaluation_does_without_jax(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_JAX], cwd=tmp_path, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "report.html").exists()


def _content(out):
    wanted = "policy_id, cell, phase, episode_index, content_hash"
    store = EvidenceStore(out / "evidence")
    return store.query(f"SELECT {wanted} FROM records ORDER BY ALL").to_pylist()


@pytest.mark.slow
def test_a_killed_evaluation_goes_on_and_its_records_are_those_of_an_undisturbed_one(
    tmp_path, monkeypatch
):
    """A testbed that runs lane by lane commits a policy's cells in rounds, here one cell each."""

    def run(out, commits=None):
        finished, finish = [], RunDirectory.finish

        def counted(self, unit, *given, **named):
            if len(finished) == commits:
                raise KeyboardInterrupt
            finish(self, unit, *given, **named)
            finished.append(unit)

        monkeypatch.setattr(RunDirectory, "finish", counted)
        try:
            integ_gym.evaluate(
                lean, "InvertedPendulum-v5", tmp_path / out, home="stock", integrators=["Euler"],
                dts=[0.02], varied={"action_latency": [0.02]}, episodes=2, workers=1,
                limit=False, progress=False,
            )  # fmt: skip
        finally:
            monkeypatch.setattr(RunDirectory, "finish", finish)
        return finished

    once = run("once")
    monkeypatch.setattr(panel_evaluate, "ROUND", 0.0)
    with pytest.raises(KeyboardInterrupt):
        run("rounds", commits=5)
    left = run("rounds")
    assert left
    assert 5 + len(left) > len(once)
    files = [*tmp_path.glob("rounds/units/*.json")]
    assert len(files) == 5 + len(left)
    markers = [json.loads(file.read_text("utf-8")) for file in files if "evaluate-" in file.name]
    assert len(markers) > 8
    assert all(len(cells) == 1 for marker in markers for cells in marker["cells"].values())
    assert _content(tmp_path / "rounds") == _content(tmp_path / "once")
    assert main(["evidence", "verify", str(tmp_path / "rounds"), "--all", "--exact"]) == 0


def _shared(episodes, *dts):
    """Tasks of two workers for two policies of the monoped on these steps, as cells and starts."""
    home = find_testbed(MONOPED, {}).home
    spec = PanelSpec(
        name="shared", env_id=MONOPED, control_period=0.02, train=(), grid=(home,), seeds=(),
        episodes=episodes, ladder=False,
    )  # fmt: skip
    cells = tuple(Cell.of(replace(home, dt=dt), "grid") for dt in dts)
    policies = (make_baseline(name, spec.nominal) for name in ("zero", "random"))
    batch = [Subject(policy, cells) for policy in policies]
    tasks = panel_evaluate.tasks_of(spec, panel_evaluate.rounds_of(spec, batch), workers=2)
    every = [task for own in tasks for task in own.values()]
    return [(own[0].missing[0].discretization.dt, len(part)) for own, part in every]


def test_workers_share_cells_the_longest_first_and_the_starts_of_the_last_ones():
    dts = (0.005, 0.001, 0.00125, 0.002, 0.004, 0.0025, 0.01)
    whole = [(dt, 8) for dt in (0.001, 0.00125, 0.002, 0.0025, 0.004)]
    assert _shared(8, *dts) == [*whole, (0.005, 4), (0.005, 4), (0.01, 4), (0.01, 4)]
    few = (0.001, 0.002, 0.004)
    assert _shared(8, *few) == [(dt, 4) for dt in few for _ in range(2)]
    assert [part for _, part in _shared(300, *dts)] == [75] * 28


def test_a_cell_comes_after_those_that_its_labels_rest_on():
    """For policies of two homes and one without: each round of theirs has a name of its own."""
    places = [replace(find_testbed(MONOPED, {}).home, dt=dt) for dt in (0.001, 0.002, 0.004)]
    spec = PanelSpec(
        name="waves", env_id=MONOPED, control_period=0.02, train=(), grid=tuple(places), seeds=(),
        episodes=1000, ladder=False,
    )  # fmt: skip
    grid = [Cell.of(place, "grid") for place in places]
    late = [
        Cell.of(place, "late", name=f"{place.name}, late", environment={"action_latency": 0.02})
        for place in places
    ]
    policy = make_baseline("zero", spec.nominal)
    homes = (*places[:2], None)
    subjects = [Subject(policy, (*late, *grid), home) for home in homes]
    turns: list[dict[object, int]] = [{} for _ in homes]
    for turn in range(6):
        waiting = [place for place, own in enumerate(subjects) if own.missing]
        chosen = panel_evaluate.next_cells(spec, [subjects[place] for place in waiting])
        for place, own in zip(waiting, chosen, strict=True):
            rounds = panel_evaluate.rounds_of(spec, [own])
            assert len({panel_evaluate.unit_of(spec, one)[0] for one in rounds}) == len(rounds)
            turns[place] |= {(c.discretization, c.changes): turn for c in own.missing}
            recorded = {cell.name: np.ones(1, bool) for cell in own.missing}
            subjects[place] = replace(
                subjects[place], recorded={**subjects[place].recorded, **recorded}
            )
    for home, own in zip(homes, turns, strict=True):
        assert len(own) == 6
        for (place, changes), turn in own.items():
            if changes is not None:
                assert own[place, None] < turn
            if home not in (None, place):
                assert own[home, changes] < turn


@pytest.mark.slow
def test_records_do_not_depend_on_how_many_workers_share_the_cells(tmp_path):
    policy = ROOT / "examples" / "robots" / "monoped_policy" / "policy.safetensors"
    for workers in (1, 2):
        integ_gym.evaluate(
            policy, MONOPED, tmp_path / str(workers), home="stock", dts=[0.002, 0.004],
            integrators=["Euler", "implicitfast"], varied={"action_latency": [0.02]}, episodes=3,
            environment={"duration": 1.0}, workers=workers, limit=False, progress=False,
        )  # fmt: skip
    one, two = (_content(tmp_path / str(workers)) for workers in (1, 2))
    assert one == two
    assert len({row["cell"] for row in one}) > 6
    store, units = EvidenceStore(tmp_path / "2" / "evidence"), tmp_path / "2" / "units"
    for file in store.files():
        own = store.only(file.name).query("SELECT min(wall_start), max(wall_end) FROM records")
        begun, ended = (column[0].as_py().timestamp() for column in own.columns)
        marker = json.loads((units / f"{file.stem}.json").read_text("utf-8"))
        assert marker["start"] <= begun < ended <= marker["end"]
        assert marker["seconds"] > 0.0


def test_what_is_for_files_is_refused_of_others(tmp_path):
    with pytest.raises(TypeError, match="obs_stats must be a file, which the run keeps; save its"):
        integ_gym.evaluate(tmp_path / "p.zip", PENDULUM, tmp_path / "out", obs_stats={"mean": [0]})
    assert not (tmp_path / "out").exists()
