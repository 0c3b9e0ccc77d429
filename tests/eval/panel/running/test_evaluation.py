"""Evaluating policies side by side gives the records of evaluating each alone."""

from __future__ import annotations

import json
from dataclasses import replace

import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest
from engine_cases import needs

from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.eval.panel.achieve import tried
from integ_gym.eval.panel.cells import (
    Cell,
    DiscretizationMixture,
    Variation,
    nominal_setup,
)
from integ_gym.eval.panel.episodes import Subject, Successes, divided, evaluate
from integ_gym.eval.panel.evaluate import evaluation_seconds, statuses
from integ_gym.eval.panel.run_directory import RunDirectory, RunDirectoryError
from integ_gym.eval.panel.spec import PanelSpec, read_spec
from integ_gym.eval.verdict import Search
from integ_gym.evidence.fields import VOLATILE_NAMES
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.baselines import BASELINES, make_baseline
from integ_gym.train.fleet.learning import initial_stack
from integ_gym.train.policy import BoxActions, DiscreteActions, MlpPolicy

CASES = {
    "IntegPendulum-v0": {"max_torque": 1.5, "start": "hanging", "duration": 2.5},
    "IntegCartPole-v0": {"duration": 0.6, "theta_threshold": 0.1},
}
VARIATIONS = (
    Variation("late", {"action_latency": 0.1}),
    Variation("noisy", {"observation_noise": 0.2}),
    Variation("heavy", {"mass": 1.3}),
)


def _spec(env_id):
    period = 0.05
    homes = tuple(Discretization(name, period, period) for name in ("explicit_euler", "rk4"))
    return PanelSpec(
        name="side by side",
        env_id=env_id,
        control_period=period,
        train=(*homes, DiscretizationMixture("both", tuple((home, 1.0) for home in homes))),
        grid=(*homes, Discretization("implicit_midpoint", 0.025, period)),
        seeds=(0, 1),
        environment=CASES[env_id],
        variations=VARIATIONS,
        episodes=2,
    )


def _network(seed, spec, policy_id):
    setup = spec.nominal
    actions = DiscreteActions(2) if setup.task.discrete else BoxActions([-1.5], [1.5])
    sizes = (len(setup.task.observation_names), 16, 16)
    stack = initial_stack([seed], sizes, actions.size, None)
    layers = [(w[0, 0], b[0, 0]) for w, b in zip(stack.weights, stack.biases, strict=True)]
    layers[-1] = (100.0 * layers[-1][0], layers[-1][1])
    return MlpPolicy(tuple(layers), "Tanh", actions, policy_id=policy_id)


def _subjects(spec):
    """Two of one home, one of another and of a mixture, and the baselines."""
    first, second, both = spec.train
    trained = [
        Subject(_network(seed, spec, f"{home.name}-{seed}"), spec.cells_of(home), home, seed)
        for home, seed in ((first, 0), (first, 1), (second, 0), (both, 1))
    ]
    baselines = (make_baseline(name, spec.nominal) for name in BASELINES)
    return [*trained, *(Subject(one, spec.cells_of(None)) for one in baselines)]


def _records(store, batch):
    table = pq.read_table(store.directory / f"{batch}.parquet")
    kept = [n for n in table.column_names if n == "content_hash" or n not in VOLATILE_NAMES]
    order = np.argsort(table.column("record_id").to_pylist())
    return table.select(kept).take(order)


@pytest.mark.slow
@pytest.mark.parametrize("env_id", CASES)
def test_records_side_by_side_are_those_of_each_policy_alone(env_id, tmp_path, monkeypatch):
    spec = replace(_spec(env_id), name="run", episode_seed=7)
    every = range(spec.episodes)
    subjects, store = _subjects(spec), EvidenceStore(tmp_path)
    counted = []
    monkeypatch.setattr("integ_gym.eval.panel.episodes.report_work", counted.append)
    store.commit_all("together", evaluate(spec, subjects, every, store, {}))
    assert len(counted) == len({cell.name for subject in subjects for cell in subject.cells})
    assert sum(counted) == pytest.approx(evaluation_seconds(spec, subjects))
    for place, subject in enumerate(subjects):
        store.commit_all(f"alone-{place}", evaluate(spec, [subject], every, store, {}))
    alone = [_records(store, f"alone-{place}") for place in range(len(subjects))]
    together = _records(store, "together")
    assert together.num_rows == sum(table.num_rows for table in alone)
    for subject, expected in zip(subjects, alone, strict=True):
        own = [p == subject.policy.policy_id for p in together.column("policy_id").to_pylist()]
        assert together.filter(own).equals(expected), subject.policy.policy_id
        assert set(expected.column("training_seed").to_pylist()) == {subject.seed}
    assert len(set(together.column("content_hash").to_pylist())) > together.num_rows / 2
    assert len(set(together.column("failure_label").to_pylist())) > 1
    (tmp_path / "together.parquet").unlink()
    assert store.verify() == []


def test_episodes_of_a_task_without_lanes_are_divided_without_a_trace(tmp_path, monkeypatch):
    """Its lanes are run one by one, so a record does not depend on how many workers share them."""
    needs("mujoco")
    monkeypatch.chdir(tmp_path)
    env_id, store = "InvertedPendulum-v5", EvidenceStore(tmp_path / "evidence")
    testbed = find_testbed(env_id, {})
    cells = tuple(Cell.of(replace(testbed.home, integrator=i), "grid") for i in ("RK4", "Euler"))
    random = make_baseline("random", nominal_setup(testbed, testbed.home.control_period))
    subject = Subject(random, cells, cells[0].discretization, 0)
    period = testbed.home.control_period
    spec = PanelSpec(
        name="run", env_id=env_id, control_period=period, train=(), grid=(), seeds=(),
        episodes=5, episode_seed=7,
    )  # fmt: skip
    store.commit_all("whole", evaluate(spec, [subject], range(5), store, {}))
    shares = divided(spec, 2)
    assert [(part.start, len(part)) for part in shares] == [(0, 3), (3, 2)]
    tables = [table for part in shares for table in evaluate(spec, [subject], part, store, {})]
    store.commit_all("parts", tables)
    whole, parts = _records(store, "whole"), _records(store, "parts")
    assert whole.num_rows == 10
    assert parts.equals(whole)
    assert len(set(whole.column("length").to_pylist())) > 1


@pytest.mark.parametrize(
    ("changed", "without_noise", "without_delay"),
    [
        ({"observation_noise": 0.1}, True, None),
        ({"action_latency": 0.05}, None, True),
        ({"action_latency": 0.05, "sensor_period": 0.1}, None, True),
        ({"latency_jitter": 0.05, "hold_probability": 0.1}, None, True),
        ({"action_latency": 0.05, "observation_noise": 0.1}, None, None),
        ({"mass": 2.0}, None, None),
    ],
)
@pytest.mark.parametrize("environment", [{}, {"observation_noise": 0.2, "sensor_period": 0.1}])
def test_the_undisturbed_cell_answers_for_what_the_perturbation_alone_brings(
    environment, changed, without_noise, without_delay
):
    rk4 = Discretization("rk4", 0.05, 0.05)
    plain = Cell.of(rk4, "grid")
    disturbed = Cell.of(rk4, "varied", environment=changed)
    known = Successes([None], [[plain, disturbed]], environment)
    known.note(plain, [0], np.array([[True]]), None)
    known.note(disturbed, [0], np.array([[False]]), None)
    (((_, said),),) = (replays.items() for replays in known.replays(disturbed, [0]))
    nothing = bool(environment)
    assert said.home == "no home"
    assert said.without_noise is (None if nothing else without_noise)
    assert said.without_delay is (None if nothing else without_delay)


WHOLE = replace(read_spec("quick"), episodes=5, episode_parts=(3, 2))
CELL = WHOLE.columns()[0]


def _search(*highest):
    return msgspec.to_builtins(Search(24.0, 1.0, highest, "by trying"))


def _tried(tmp_path, *parts):
    directory = RunDirectory(tmp_path / "run", {"name": "run"})
    directory.make_folders()
    for first, success, search in parts:
        unit = f"achieve-cell-{first}"
        directory.finish(
            unit, "key", 0.0, first=first, cell=CELL.name, success=success, recovered=success,
            search=search,
        )  # fmt: skip
    return directory


def test_a_cell_is_judged_by_the_starts_that_there_were(tmp_path):
    """Each part's records are labelled by it and the parts before, the panel by all."""
    parts = (3, [1.0, 1.0], None), (0, [0.0, 0.0, 0.0], _search(0.1, 0.2, 0.3))
    directory = _tried(tmp_path, *parts)
    first, whole = WHOLE.parts()
    assert statuses(first, directory) == {CELL.name: "unachievable"}
    assert statuses(whole, directory) == {CELL.name: "undecided"}, "no search rules all of it out"
    assert tried(directory)[CELL.name].success == (0.0, 0.0, 0.0, 1.0, 1.0)


def test_searches_from_all_starts_rule_a_cell_out_together(tmp_path):
    parts = (0, [0.0], _search(0.1)), (3, [0.0, 0.0], _search(0.2, 2.0))
    directory = _tried(tmp_path, *parts)
    assert tried(directory)[CELL.name].search.highest == (0.1, 0.2, 2.0)
    assert statuses(WHOLE, directory) == {CELL.name: "unachievable"}


@pytest.mark.parametrize("change", [{}, {"first": "3"}])
def test_a_marker_says_which_starts_it_is_of(tmp_path, change):
    directory = _tried(tmp_path, (0, [1.0], None))
    (marker,) = (tmp_path / "run" / "units").glob("*.json")
    held = json.loads(marker.read_text())
    del held["first"]
    marker.write_text(json.dumps({**held, **change}))
    with pytest.raises(RunDirectoryError, match=r"is damaged: .*'first'"):
        tried(directory)
