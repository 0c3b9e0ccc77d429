"""Any argument as an axis: expanded tables, their cells, and what each difference costs."""

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from scipy import stats
from small_panel import bare_data

import integ_gym
from integ_gym.cli import main
from integ_gym.eval.panel.cells import SpecError, axes_between
from integ_gym.eval.panel.checking.page import against_plan
from integ_gym.eval.panel.claims import parse_claim
from integ_gym.eval.panel.plan import read_planned_spec
from integ_gym.eval.panel.result import read_panel
from integ_gym.eval.panel.spec import SCHEMA_PATH, parse_spec, schema_text
from integ_gym.evidence.store import EvidenceStore

ROOT = Path(__file__).resolve().parents[3]
HOME = {"integrator": "symplectic_euler", "dt": 0.05}


def _spec(*evaluate, **others):
    return parse_spec(bare_data(HOME, *evaluate, **others), "test")


def _cells(spec):
    return {cell.name: cell for cell in spec.cells_of(spec.train[0])}


def test_shorthand_and_tables_make_the_same_cells():
    short = _spec(
        perturbations=[{"name": "heavy", "environment": {"mass": 1.2}}],
        sweep=[{"argument": "damping", "values": [0.2, 0.0, 0.1]}],
    )
    table = _spec(
        {"at": ["home", "truth"], "name": "heavy", "mass": 1.2}, {"damping": [0.0, 0.1, 0.2]}
    )
    assert _cells(short) == _cells(table)
    on_truth = (cell for cell in _cells(table).values() if cell.at == "reference dt=0.05")
    changes = [cell.environment for cell in on_truth]
    assert changes == [{"mass": 1.2}, {"damping": 0.1}, {"damping": 0.2}]


def test_the_truth_is_solved_at_every_control_period():
    spec = _spec({**HOME, "dt": 0.0125, "control_period": [0.025, 0.1]})
    cells = _cells(spec)
    truths = {c.control_period for c in cells.values() if c.reference}
    assert truths == {0.05, 0.025, 0.1}
    assert {c.control_period for c in cells.values() if c.dt == 0.0125} == {0.025, 0.1}


def test_a_row_may_have_a_control_period_of_its_own():
    own = {**HOME, "control_period": [0.05, 0.1]}
    spec = _spec(own, train=[own])
    assert [spec.name_of(home) for home in spec.train] == [
        "symplectic_euler dt=0.05",
        "symplectic_euler dt=0.05 control=0.1",
    ]
    second = spec.cells_of(spec.train[1])
    assert second[0].discretization == spec.train[1]


def test_what_cannot_be_is_left_out_and_said():
    spec = _spec({"action_latency": [0.02, 0.05]}, {**HOME, "control_period": [0.075, 0.1]})
    names = set(_cells(spec))
    assert "symplectic_euler dt=0.05, action_latency=0.02" not in names
    assert "reference dt=0.05, action_latency=0.02" in names
    said = " ".join(spec.gaps())
    assert "action_latency=0.02" in said
    assert "0.075" in said


@pytest.mark.parametrize(
    ("changes", "fault"),
    [({"action_latency": 0.02}, "multiple"), ({"solver": {"iterations": 2}}, "has no solver")],
)
def test_what_can_be_nowhere_is_refused(changes, fault):
    with pytest.raises(SpecError, match=f"in no cell: .*{fault}"):
        _spec({"at": "home", **changes})


@pytest.mark.parametrize(
    ("table", "about"),
    [
        ({"at": "elsewhere", "mass": 1.2}, "at"),
        ({"at": "home"}, "varies nothing"),
        ({"name": "finer", "integrator": "rk4", "dt": 0.01}, "varies nothing"),
        ({"at": "home", "masss": 1.2}, "mass"),
        ({"integrator": "rk4", "mass": 1.2}, "dt"),
    ],
)
def test_a_wrong_table_is_refused(table, about):
    with pytest.raises(SpecError, match=about):
        _spec(table)


@pytest.mark.parametrize(
    ("env_id", "other"),
    [("IntegQuadrotor-v0", {"way_point_period": 3.0}), ("IntegReacher-v0", {"actuator": "effort"})],
)
def test_another_state_or_other_controls_are_refused_before_anything_runs(env_id, other):
    with pytest.raises(SpecError, match="give the argument to all cells"):
        _spec(
            env_id=env_id, environment={}, perturbations=[{"name": "other", "environment": other}]
        )
    _spec(env_id=env_id, environment=other)


def test_cells_of_single_differences_are_added():
    spec = _spec({"integrator": "rk4", "dt": 0.025, "control_period": 0.1, "mass": 1.2})
    home, cells = spec.train[0], _cells(spec)
    found = {frozenset(axes_between(home, cell)) for cell in cells.values() if not cell.reference}
    axes = {"integration", "held action", "plant"}
    assert found == {
        frozenset(),
        *(frozenset({a}) for a in axes),
        *(frozenset(axes - {a}) for a in axes),
        frozenset(axes),
    }


def test_a_plan_is_read_as_it_was_written():
    spec = _spec({"at": [{**HOME, "dt": 0.025}], "action_latency": [0.0, 0.05]}, {"mass": 1.2})
    again = read_planned_spec(json.loads(json.dumps(spec.to_json())))
    assert again.cells_of(again.train[0]) == spec.cells_of(spec.train[0])


def push(observation):
    """Balances a cart-pole at home, and hardly with late commands."""
    return int(observation[2] + 0.3 * observation[3] > 0.0)


@pytest.fixture(scope="module")
def varied_run(tmp_path_factory):
    out = tmp_path_factory.mktemp("varied") / "out"
    integ_gym.evaluate(
        push, "IntegCartPole-v0", out,
        home={"integrator": "explicit_euler", "dt": 0.02, "control_period": 0.02},
        integrators=["explicit_euler", "rk4"], dts=[0.02], episodes=6, workers=1, progress=False,
        environment={"duration": 2.0}, at=["home"],
        varied={"control_period": [0.02, 0.04], "action_latency": [0.0, 0.2]},
    )  # fmt: skip
    return out


def _held(panel):
    return [one for one in panel.separations if "held action" in [a.axis for a in one.axes]]


def test_what_each_difference_costs(varied_run):
    panel = read_panel(varied_run / "panel.json")
    (found,) = (one for one in _held(panel) if one.measure == "success")
    home = np.array([panel.entry(found.row, panel.row(found.row).home).success.estimate])
    assert {axis.axis for axis in found.axes} == {"held action", "delay"}
    for axis in found.axes:
        for name, lost in ((axis.alone, axis.lost_alone), (axis.without, axis.lost_without)):
            there = panel.entry(found.row, name).success.estimate
            assert math.isclose(lost.estimate, home[0] - there, abs_tol=1e-12)
            assert lost.ends[0] <= lost.estimate <= lost.ends[1]
    late = next(axis for axis in found.axes if axis.axis == "delay")
    assert panel.cell(late.alone).environment == {"action_latency": 0.2}
    rates = EvidenceStore(varied_run / "evidence").query(
        "SELECT avg(success::INT) AS rate, count(*) AS n FROM records "
        f"WHERE phase = 'evaluation' AND policy_id = '{found.row}' AND cell = '{late.alone}'"
    ).to_pylist()  # fmt: skip
    assert rates == [{"rate": panel.entry(found.row, late.alone).success.estimate, "n": 6}]
    assert late.lost_alone.estimate > 0.5
    answer = panel.answer.splitlines()[-1]
    assert found.cell in answer
    assert "delay" in answer


def test_what_each_difference_costs_of_the_return(varied_run):
    """From the records: mean difference of returns over 2 s, with Student's interval."""
    panel = read_panel(varied_run / "panel.json")
    (found,) = (one for one in _held(panel) if one.measure == "return_per_second")
    store = EvidenceStore(varied_run / "evidence")

    def per_second(cell):
        rows = store.query(
            "SELECT \"return\" AS earned FROM records WHERE phase = 'evaluation' AND "
            f"policy_id = '{found.row}' AND cell = '{cell}' ORDER BY episode_index"
        )
        return np.array(rows.column("earned").to_pylist()) / 2.0

    home = per_second(panel.row(found.row).home)
    pairs = [(found.cell, found.lost)]
    pairs += [
        pair for a in found.axes for pair in ((a.alone, a.lost_alone), (a.without, a.lost_without))
    ]
    assert len(pairs) == 5
    for cell, lost in pairs:
        drop = home - per_second(cell)
        half = stats.t.ppf(0.975, 5) * drop.std(ddof=1) / np.sqrt(6)
        assert lost.estimate == pytest.approx(drop.mean())
        assert lost.ends == pytest.approx((drop.mean() - half, drop.mean() + half))
    page = (varied_run / "report.html").read_text()
    assert "Return per second" in page


def test_the_run_is_verified_to_the_last_bit(varied_run):
    assert list(against_plan(varied_run, own_code=True)) == []
    assert EvidenceStore(varied_run / "evidence").verify() == []


def test_a_claim_is_shown_by_the_end_of_the_interval_against_it(varied_run):
    panel = read_panel(varied_run / "panel.json")
    late = "explicit_euler dt=0.02, action_latency=0.2"
    assert late in str(parse_claim(f"loss > 0.3 in {late}").find_support(panel))
    assert parse_claim("loss > 0.99").find_support(panel) is None
    assert parse_claim("success < 0.5").find_support(panel)
    assert parse_claim("success > 0.5 in rk4 dt=0.02").find_support(panel)
    with pytest.raises(ValueError, match=r"rk4 dt=0\.02"):
        parse_claim("loss > 0.1 in rk4").find_support(panel)
    for wrong in ("loss >", "regret > 0.1", "loss = 0.1"):
        with pytest.raises(ValueError, match="--fail-if"):
            parse_claim(wrong)


@pytest.mark.slow
def test_a_pipeline_fails_on_a_claim(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gate_policy.py").write_text(
        "def push(observation):\n    return int(observation[2] > 0.0)\n"
    )
    command = [
        "evaluate", "--policy", "gate_policy:push", "--env", "IntegCartPole-v0", "--out", "out",
        "--home", "stock", "--integrator", "rk4", "--dt", "0.02", "--episodes", "5",
        "--workers", "1", "--env-arg", "duration=1.0", "--no-progress",
    ]  # fmt: skip
    assert main([*command, "--fail-if", "success > 0.99 in rk5 dt=0.02"]) == 2
    assert "Did you mean 'rk4 dt=0.02'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main([*command, "--fail-if", "success > 0.99 in rk4 dt=0.02"]) == 0
    assert main([*command, "--fail-if", "success < 0.99"]) == 3
    assert "success < 0.99" in capsys.readouterr().err


def test_the_published_schema_takes_what_is_parsed():
    assert SCHEMA_PATH.read_text(encoding="utf-8") == schema_text()
    validator = Draft202012Validator(json.loads(schema_text()))
    text = (ROOT / "specs" / "pendulum_mixtures.toml").read_text(encoding="utf-8")
    data = tomllib.loads(text)
    assert list(validator.iter_errors(data)) == []
    assert list(validator.iter_errors({**data, "evaluates": []}))
    assert list(validator.iter_errors({**data, "seeds": [-1]}))


def test_a_place_that_is_stated_is_a_cell_where_nothing_changes_in_it():
    place = {"integrator": "symplectic_euler", "dt": 0.01}
    cells = _cells(_spec({"at": place, "control_period": [0.05, 0.1]}))
    assert {"symplectic_euler dt=0.01", "symplectic_euler dt=0.01 control=0.1"} <= set(cells)
    assert _cells(_spec({"at": HOME, "control_period": 0.05})).keys() == _cells(_spec()).keys()
