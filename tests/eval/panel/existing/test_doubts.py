"""Doubts of an evaluation: each where there is cause, in a sentence with its remedy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import duckdb
import numpy as np
import pyarrow as pa
import pytest
from known_outcomes import matrix_of
from mountain_car import swing

import integ_gym
from integ_gym.cli import main
from integ_gym.eval.panel.doubts import doubts_of
from integ_gym.eval.panel.existing import plan
from integ_gym.eval.panel.matrix import PanelLayout, given_rows
from integ_gym.eval.panel.policies import given_policy, read_existing
from integ_gym.eval.panel.result import Policy
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.baselines import BASELINES
from integ_gym.train.policy import BoxActions, DiscreteActions, MlpPolicy
from integ_gym.train.policy_files.writing import save_policy, write_sidecar

PENDULUM = "IntegPendulum-v0"
HOME, OTHER, TRUTH = "rk4 dt=0.05", "explicit_euler dt=0.05", "reference dt=0.05"
STATED = "integrator=rk4,dt=0.05,control_period=0.05"
EPISODES = 20


def still(observation):
    return [0.0]


def _doubts(outcome: Callable[[str, str], tuple[float, float]], home=STATED):
    """Of a policy whose success and mean return in a cell, by row and cell, are given."""
    return _doubts_of(given_policy(still, PENDULUM, {}, home), outcome)


class _Records:
    """Ten decisions in an episode, in so many of which the fallback acted."""

    def __init__(self, fallbacks: int = 0) -> None:
        self.fallbacks = fallbacks

    def query(self, sql: str) -> pa.Table:
        common = {"phase": "evaluation", "length": 10, "perturbation": None, "record_id": "",
                  "cell": HOME, "solver_status": "ok", "substeps": 1,
                  "engine_description": "{}"}  # fmt: skip
        acted = {"still": self.fallbacks, "random": 10}
        table = pa.Table.from_pylist(
            [{**common, "policy_id": name, "fallback_count": n} for name, n in acted.items()]
            + [{**common, "policy_id": "still", "fallback_count": 10, "perturbation": "mass +20 %"}]
        )
        connection = duckdb.connect()
        connection.register("records", table)
        return connection.sql(sql).to_arrow_table()


def _found(existing, outcome):
    """Specification, layout and matrix of an evaluation with these outcomes."""
    name = existing.policy.policy_id
    spec = plan(existing, PENDULUM, ["rk4", "explicit_euler"], [0.05], EPISODES)
    rows, homes = given_rows(spec, Policy(id=name), existing.home)
    layout = PanelLayout.of(spec, rows, homes, {}, {})
    noise = np.linspace(-1.0, 1.0, EPISODES)

    def told(row, cell, _, k):
        success, mean = outcome(row.name, cell)
        own = noise if row.name == name else noise[::-1]
        return {"return": mean + own[k], "success": k < success * EPISODES}

    return spec, layout, matrix_of(layout, EPISODES, told)


def _doubts_of(existing, outcome, fallbacks=0):
    return doubts_of(existing, *_found(existing, outcome), _Records(fallbacks))


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
def test_what_does_far_better_elsewhere_casts_doubt_on_its_home(own, fragment):
    (said,) = _doubts(_told(own))
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
def test_of_a_home_that_may_be_right_there_is_no_doubt(own):
    assert _doubts(_told(own)) == ()


def test_a_cell_that_is_milder_to_everybody_casts_none():
    def milder(row, cell):
        return 0.0, -10.0 if cell == OTHER else -100.0

    (said,) = _doubts(milder)
    assert "no better than random's" in said or "not shown to be better" in said
    assert "home right" not in said


def test_of_an_unknown_home_none_is_cast_on_it():
    said = _doubts(_told({HOME: (0.1, -50.0), OTHER: (0.9, -10.0)}), home=None)
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
        doubts = _doubts_of(existing, _told(WELL))
        assert [one.startswith(said) for one in doubts] == ([] if said is None else [True])
        assert said is None or "--env-arg" in doubts[0]


def test_arguments_that_contradict_the_side_car_are_told_with_both_numbers(tmp_path):
    path = save_policy(
        _limited(0.8), tmp_path / "mine.safetensors", PENDULUM, home=STATED,
        environment={"max_torque": 0.8},
    )  # fmt: skip
    existing = read_existing(path, PENDULUM, {"max_torque": 1.5})
    (said,) = _doubts_of(existing, _told(WELL))
    assert said.startswith("mine was trained with max_torque=0.8 (the side-car beside the policy)")
    assert "was judged with max_torque=1.5; leave out --env-arg max_torque" in said
    for given in ({}, {"max_torque": 0.8}, {"duration": 9.0}):
        existing = read_existing(path, PENDULUM, given)
        assert _doubts_of(existing, _told(WELL)) == ()
    write_sidecar(path, PENDULUM, home=STATED)
    (said,) = _doubts_of(read_existing(path, PENDULUM, {}), _told(WELL))
    assert "±0.8, and the environment takes ±2" in said


def _far(observation):
    return [np.nan if observation[0] < 0.9 else 0.5]


def _now_and_then(observation):
    return [np.inf if observation[2] > 3.0 else 0.5]


@pytest.mark.slow
@pytest.mark.parametrize("given", [f"{__name__}:_far", Path(f"{__name__}:_now_and_then")])
def test_actions_that_are_no_finite_numbers_are_counted(given, tmp_path):
    """Of a function that is named in the place of a file."""
    panel = integ_gym.evaluate(
        given, PENDULUM, tmp_path, home=STATED, integrators=["rk4"], dts=[0.05], episodes=3,
        environment={"duration": 2.0}, workers=1, progress=False,
    )  # fmt: skip
    counts = "SELECT sum(fallback_count) AS n, sum(length) AS decisions FROM records"
    judged = "phase = 'evaluation' AND perturbation IS NULL"
    rows = f"{counts} WHERE policy_id = '{panel.rows[0].name}' AND {judged}"
    (found,) = EvidenceStore(tmp_path / "evidence").query(rows).to_pylist()
    share = (
        f"in {100 * found['n'] / found['decisions']:.0f} % of control periods the fallback acted"
    )
    name = panel.rows[0].name
    assert name.strip("_-") in ("far", "now_and_then", "now-and-then")
    assert panel.warnings[0].startswith(f"{share}, because {name} gave no finite action")


@pytest.mark.parametrize(
    ("fallbacks", "latency", "said"),
    [(0, 0.0, None), (3, 0.0, "in 30 % of"), (2, 0.1, None), (5, 0.1, "in 30 % of")],
)
def test_decisions_before_the_first_command_arrives_are_not_counted(fallbacks, latency, said):
    existing = given_policy(still, PENDULUM, {"action_latency": latency}, STATED)
    found = _doubts_of(existing, _told(WELL), fallbacks)
    assert [one.startswith(said) for one in found] == ([] if said is None else [True])


def test_what_has_no_bounds_is_not_told_of_any():
    layers = ((np.zeros((2, 4)), np.zeros(2)),)
    assert MlpPolicy(layers, "Tanh", DiscreteActions(2)).bounds is None
    assert _limited(float(np.finfo(np.float32).max)).bounds is None
    assert _doubts(_told(WELL)) == ()


def test_a_cell_where_nothing_outlives_its_first_decision_is_no_fault_of_the_policys(tmp_path):
    """The speed passes its bound at such a gravity."""
    panel = integ_gym.evaluate(
        still, PENDULUM, tmp_path, home=STATED, integrators=["rk4"], dts=[0.05], episodes=2,
        varied={"gravity": [10.0, 1e9]}, at=["home"], workers=1, progress=False,
    )  # fmt: skip
    (doubt,) = (one for one in panel.warnings if "first decision" in one)
    assert "gravity=1e+09" in doubt


OF_TASK = "integrator=symplectic_euler,dt=1,control_period=1"


def _evaluated(kind, out, dts=(1.0, 0.5), limit=None, **environment):
    return integ_gym.evaluate(
        swing, f"mountain_car:{kind}", out, dts=dts, episodes=2, home=OF_TASK, workers=1,
        environment=environment, limit=limit,
    )  # fmt: skip


@pytest.fixture(scope="module")
def upside_down(tmp_path_factory):
    """Nothing says that the task ends at its goal, so surviving is the success."""
    out = tmp_path_factory.mktemp("upside")
    return _evaluated("SilentMountainCar", out), out


def test_a_rule_of_success_that_is_upside_down_is_said_first(upside_down):
    panel, out = upside_down
    first = (
        "The rule of success looks wrong: on gymnasium symplectic_euler dt=1, random succeeds "
        "in 100 % of episodes with a mean return of −6.9, and swing succeeds in 0 % of episodes "
        "with a mean return of 8"
    )
    assert panel.answer.startswith(first)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "The rule of success looks wrong: on" in page


def test_rewards_that_differ_in_kind_cast_doubt_where_nothing_is_said(upside_down):
    panel, out = upside_down
    (told,) = [doubt for doubt in panel.warnings if "SilentMountainCar" in doubt]
    assert "the reward of the decision that ends an episode (99.9) is of another kind" in told
    assert "those before it (-0.1)" in told
    assert 'give `held` rewards="rate", "sum" or "last"' in told
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "is of another kind than those before it" in page


def test_amounts_that_are_taken_for_rates_cast_doubt(tmp_path, capsys):
    command = ["evaluate", "--policy", "mountain_car:swing", "--env"]
    command += ["mountain_car:SilentScaledMountainCar", "--dt", "1", "--dt", "0.5"]
    command += ["--episodes", "2", "--success-return", "90", "--home", OF_TASK, "--workers", "1"]
    assert main([*command, "--out", str(tmp_path / "out"), "--no-progress"]) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "rewards shrink with `dt` as amounts do that are scaled by it: a decision of" in told
    assert "SilentScaledMountainCar does not say what its rewards are" in told


@pytest.mark.parametrize("kind", ["MountainCar", "ScaledMountainCar"])
def test_of_rewards_that_are_said_there_is_no_doubt(kind, tmp_path):
    panel = _evaluated(kind, tmp_path, success_return=80.0)
    assert panel.warnings == ()
    assert "looks wrong" not in panel.answer


def test_episodes_that_all_begin_alike_cast_doubt(tmp_path):
    panel = _evaluated("FixedMountainCar", tmp_path, success_return=80.0)
    (doubt,) = panel.warnings
    assert doubt.startswith("all 2 episodes begin with the same observation")
    assert "draw starts at random" in doubt


def test_of_one_step_per_decision_there_is_no_doubt(tmp_path):
    panel = _evaluated("SilentMountainCar", tmp_path, [1.0], success_return=80.0, limit=False)
    assert panel.warnings == ()


def test_doubts_follow_from_the_records(upside_down, capsys):
    """So that verifying the run finds nothing to object to."""
    _, out = upside_down
    assert main(["evidence", "verify", str(out), "--no-progress"]) == 0, capsys.readouterr()
