"""Doubts of an evaluation: each where there is cause, in a sentence with its remedy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from integ_gym.eval.panel.existing.doubts import doubts_of
from integ_gym.eval.panel.existing.given import given_policy
from integ_gym.eval.panel.existing.planning import plan
from integ_gym.eval.panel.existing.policy import read_existing
from integ_gym.eval.panel.results import Matrix, PanelLayout, given_rows
from integ_gym.evidence import EvidenceStore
from integ_gym.train import BASELINES, save_policy, write_sidecar
from integ_gym.train.policy import BoxActions, DiscreteActions, MlpPolicy

PENDULUM = "IntegPendulum-v0"
HOME, OTHER, TRUTH = "rk4 dt=0.05", "explicit_euler dt=0.05", "reference dt=0.05"
STATED = "integrator=rk4,dt=0.05,control_period=0.05"
EPISODES = 20


def still(observation):
    return [0.0]


def _doubts(tmp_path, outcome: Callable[[str, str], tuple[float, float]], home=STATED):
    """Of a policy whose success and mean return in a cell, by row and cell, are given."""
    return _doubts_of(given_policy(still, PENDULUM, {}, home), tmp_path, outcome)


def _doubts_of(existing, tmp_path, outcome):
    name = existing.policy.policy_id
    spec = plan(existing, PENDULUM, ["rk4", "explicit_euler"], [0.05], EPISODES)
    layout = PanelLayout.of(spec, given_rows(spec, name, existing.home), {}, {})
    noise = np.linspace(-1.0, 1.0, EPISODES)
    records = []
    for row in layout.rows:
        for cell in layout.cells_of[row.name]:
            success, mean = outcome(row.name, cell)
            records += [
                {"policy_id": row.name, "cell": cell, "episode_index": k, "return": mean + x,
                 "success": k < success * EPISODES}
                for k, x in enumerate(noise if row.name == name else noise[::-1])
            ]  # fmt: skip
    matrix = Matrix(layout.rows, records, EPISODES)
    return doubts_of(existing, spec, layout, matrix, EvidenceStore(tmp_path))


def _told(own: dict[str, tuple[float, float]], chance: float = -100.0):
    """The policy's outcomes by cell, that of its home elsewhere; the baselines' everywhere."""
    return lambda row, cell: (
        (0.0, chance) if row in BASELINES else own.get(cell.partition(",")[0], own[HOME])
    )


@pytest.mark.parametrize(
    ("own", "fragment"),
    [
        (
            {HOME: (0.1, -50.0), OTHER: (0.9, -10.0)},
            f"still does far better on {OTHER} than at its stated home ({HOME}), with a mean "
            "success of 0.90 where that gives 0.10",
        ),
        (
            {HOME: (0.0, -100.0), TRUTH: (0.0, -10.0)},
            f"random's -100.0; it does far better on {TRUTH} than at its stated home ({HOME}), "
            "with a mean return of -10.0 where that gives -100.0",
        ),
    ],
)
def test_what_does_far_better_elsewhere_casts_doubt_on_its_home(own, fragment, tmp_path):
    (said,) = _doubts(tmp_path, _told(own))
    assert fragment in said
    assert said.endswith("(adjusted p < 0.001): is --home right?")
    assert "long enough" not in said


@pytest.mark.parametrize(
    "own",
    [
        {HOME: (0.9, -10.0), OTHER: (0.1, -50.0)},
        {HOME: (0.8, -10.0), OTHER: (0.95, -9.0)},  # not far
        {HOME: (0.0, -40.0), OTHER: (0.0, -10.0)},  # less than twice the lead over random
    ],
)
def test_of_a_home_that_may_be_right_there_is_no_doubt(own, tmp_path):
    assert _doubts(tmp_path, _told(own)) == ()


def test_a_cell_that_is_milder_to_everybody_casts_none(tmp_path):
    def milder(row, cell):
        return 0.0, -10.0 if cell == OTHER else -100.0

    (said,) = _doubts(tmp_path, milder)
    assert "no better than random's" in said or "not shown to be better" in said
    assert "home right" not in said


def test_of_an_unknown_home_none_is_cast_on_it(tmp_path):
    said = _doubts(tmp_path, _told({HOME: (0.1, -50.0), OTHER: (0.9, -10.0)}), home=None)
    assert [one for one in said if "right?" in one] == []


WELL = {HOME: (1.0, -10.0)}


def _limited(bound: float) -> MlpPolicy:
    layers = ((np.zeros((1, 3)), np.zeros(1)),)
    return MlpPolicy(layers, "Tanh", BoxActions(np.array([-bound]), np.array([bound])))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "mine gives actions within ±0.8, and the environment takes ±2: was it trained with"),
        ({"max_torque": 1.5}, "mine gives actions within ±0.8, and the environment takes ±1.5:"),
        ({"max_torque": 0.8}, None),
    ],
)
def test_other_bounds_than_the_environments_are_told_with_both_numbers(given, said, tmp_path):
    path = save_policy(_limited(0.8), tmp_path / "mine.safetensors", PENDULUM, home=STATED)
    path.with_suffix(".json").unlink()
    for existing in (
        read_existing(path, PENDULUM, given, home=STATED),
        given_policy(replace(_limited(0.8), policy_id="mine"), PENDULUM, given, STATED),
    ):
        doubts = _doubts_of(existing, tmp_path, _told(WELL))
        assert [one.startswith(said) for one in doubts] == ([] if said is None else [True])
        assert said is None or "--env-arg" in doubts[0]


def test_what_has_no_bounds_is_not_told_of_any(tmp_path):
    layers = ((np.zeros((2, 4)), np.zeros(2)),)
    assert MlpPolicy(layers, "Tanh", DiscreteActions(2)).bounds is None
    assert _limited(float(np.finfo(np.float32).max)).bounds is None
    assert _doubts(tmp_path, _told(WELL)) == ()


def test_arguments_that_contradict_the_side_car_are_told_with_both_numbers(tmp_path):
    path = save_policy(
        _limited(0.8), tmp_path / "mine.safetensors", PENDULUM, home=STATED,
        environment={"max_torque": 0.8},
    )  # fmt: skip
    existing = read_existing(path, PENDULUM, {"max_torque": 1.5})
    (said,) = _doubts_of(existing, tmp_path, _told(WELL))
    assert said.startswith("mine was trained with max_torque=0.8 (the side-car beside the policy)")
    assert "was judged with max_torque=1.5; leave out --env-arg max_torque" in said
    for given in ({}, {"max_torque": 0.8}, {"duration": 9.0}):
        existing = read_existing(path, PENDULUM, given)
        assert _doubts_of(existing, tmp_path, _told(WELL)) == ()
    write_sidecar(path, PENDULUM, home=STATED)
    (said,) = _doubts_of(read_existing(path, PENDULUM, {}), tmp_path, _told(WELL))
    assert "±0.8, and the environment takes ±2" in said
