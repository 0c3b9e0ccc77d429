"""Where there is no truth: the limit's steps, its extrapolation, and when it is not called one."""

from __future__ import annotations

import json
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from engine_cases import needs
from known_outcomes import matrix_of, panel_of

import integ_gym
from integ_gym.cli import main
from integ_gym.envs.registries import ENGINES, INTEGRATORS
from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.eval.panel.cells import Cell, SpecError
from integ_gym.eval.panel.claims import parse_claim
from integ_gym.eval.panel.conclusions import answer_lines, finding_of, limit_words
from integ_gym.eval.panel.limit import PARTS, extrapolate, order_of, steps_of_limit
from integ_gym.eval.panel.matrix import PanelLayout
from integ_gym.eval.panel.plan import read_planned_spec
from integ_gym.eval.panel.result import Panel, Policy, Row, read_panel
from integ_gym.eval.panel.spec import parse_spec
from integ_gym.eval.report.episodes import choice_words
from integ_gym.eval.report.matrices import success_matrix
from integ_gym.eval.share import write_cards
from integ_gym.eval.statistics import paired_success

HOME = Discretization("symplectic_euler", 0.05, 0.05, "gymnasium")
STEPS = [replace(HOME, dt=HOME.dt / part) for part in PARTS]


def test_the_steps_are_of_the_integrator_of_highest_order_at_the_homes_control_period():
    testbed = find_testbed("IntegPendulum-v0", {})
    for integrator in testbed.integrators("native"):
        home = Discretization(integrator, 0.05, 0.1)
        steps = steps_of_limit(testbed, [home], home)
        assert [(one["part"], one["dt"]) for one in steps] == [(p, 0.05 / p) for p in PARTS]
        assert {one["control_period"] for one in steps} == {0.1}
        (chosen,) = {one["integrator"] for one in steps}
        assert order_of(replace(home, integrator=chosen)) == max(
            INTEGRATORS.load(name).order for name in testbed.integrators("native")
        )


def test_of_integrators_of_one_order_the_homes_own_is_taken():
    home = Discretization("explicit_euler", 0.02, 0.02, "gymnasium")
    steps = steps_of_limit(find_testbed("CartPole-v1", {}), [home], home)
    assert {one["integrator"] for one in steps} == {"explicit_euler"}


def test_every_engine_tells_the_order_of_its_integrators():
    for engine in ENGINES.parts:
        for name, one_step_map in ENGINES.load(engine).maps.items():
            order = order_of(Discretization(name, 0.05, 0.05, engine))
            assert order >= 1
            assert order == 4 or one_step_map != "rk4"
    assert order_of(Discretization("RK4", 0.01, 0.01, "dm_control")) == 4
    assert order_of(Discretization("Euler", 0.01, 0.01, "dm_control")) == 1


def test_a_solver_is_tighter_at_the_limit_than_at_home():
    needs("mujoco")
    testbed = find_testbed("InvertedPendulum-v5", {})
    at_home = testbed.make(testbed.home, 1).setups[0].settings.solver
    for one in steps_of_limit(testbed, (), testbed.home):
        assert one["integrator"] == "RK4"
        assert one["solver"]["tolerance"] < at_home["tolerance"]
        assert one["solver"]["iterations"] > at_home["iterations"]


SPEC = {
    "name": "limits", "env_id": "IntegPendulum-v0", "control_period": 0.05, "seeds": [0],
    "limit": True, "train": [{"integrator": "rk4", "dt": 0.05}],
    "evaluate": [{"integrator": "rk4", "dt": [0.05, 0.025, 0.0125]}],
}  # fmt: skip


def test_steps_that_the_grid_has_are_its_cells_and_nothing_is_run_twice():
    spec = parse_spec(SPEC, "test")
    cells = spec.cells_of(spec.train[0])
    found = {cell.limit_part: (cell.name, cell.kind) for cell in cells if cell.limit_part}
    assert found == {
        2: ("rk4 dt=0.025", "grid"), 4: ("rk4 dt=0.0125", "grid"), 8: ("rk4 dt=0.00625", "limit"),
    }  # fmt: skip
    places = [(cell.discretization, cell.changes) for cell in cells]
    assert len(places) == len(set(places))
    assert [cell.name for cell in spec.columns() if cell.kind == "limit"] == ["rk4 dt=0.00625"]


def test_a_plan_holds_the_steps_and_a_specification_without_a_limit_has_none():
    spec = parse_spec(SPEC, "test")
    assert read_planned_spec(spec.to_json()).limit == spec.limit
    without = parse_spec({**SPEC, "limit": False}, "test")
    assert not without.limit
    assert "limit" not in without.to_json()


class Coarse(integ_gym.GymTestbed):
    """A pendulum that takes no other step than its own."""

    home = HOME
    choices = ("symplectic_euler",)

    def build(self, discretization, **arguments):
        if discretization.dt != self.home.dt:
            raise ValueError("no other step")
        return find_testbed("Pendulum-v1", {}).build(discretization, **arguments)

    def read(self, env):
        return self.as_applied("symplectic_euler", env.unwrapped.dt, env)


def test_by_default_there_is_a_limit_where_there_is_no_truth_and_its_steps_fit():
    spec = {name: value for name, value in SPEC.items() if name != "limit"}
    assert not parse_spec(spec, "test").limit
    home = [{"integrator": "symplectic_euler", "dt": 0.05}]
    foreign = {"train": home, "evaluate": home, "trainer": "sb3"}
    made = parse_spec({**spec, **foreign, "env_id": "Pendulum-v1"}, "test")
    assert [one["dt"] for one in made.limit] == [0.05 / part for part in PARTS]
    alone = parse_spec({**spec, **foreign, "env_id": f"{__name__}:Coarse"}, "test")
    assert not alone.limit
    assert any(
        "No limit is extrapolated" in told and "no other step" in told for told in alone.gaps()
    )


def test_a_limit_whose_steps_cannot_be_made_is_refused():
    with pytest.raises(SpecError, match="no other step"):
        parse_spec({**SPEC, "limit": True, "env_id": f"{__name__}:Coarse"}, "test")
    with pytest.raises(SpecError, match="limit"):
        parse_spec({**SPEC, "limit": 3}, "test")


@pytest.mark.parametrize("order", [1, 2, 4])
def test_returns_go_to_what_an_error_of_the_integrators_order_leads_to(order):
    true, slope = np.array([[1.0, -3.0, 0.0]]), np.array([[5.0, -2.0, 0.0]])
    returns = [true + slope * (0.1 / part) ** order for part in PARTS]
    found = extrapolate([np.ones((1, 3))] * 3, returns, order)
    assert found.returns == pytest.approx(true, abs=1e-12)
    assert not found.changed.any()


def test_an_observed_order_below_the_integrators_is_what_counts():
    found = extrapolate([np.ones((1, 1))] * 3, [np.array([[1.0 / p]]) for p in PARTS], 4)
    assert found.returns == pytest.approx(0.0, abs=1e-12)


def test_differences_that_do_not_shrink_are_not_extrapolated():
    returns = [np.array([[0.0, 0.0]]), np.array([[1.0, 1.0]]), np.array([[2.0, 0.5]])]
    found = extrapolate([np.ones((1, 2))] * 3, returns, 4)
    assert found.returns.tolist() == [[2.0, 0.5]]
    assert found.return_slack == pytest.approx(0.75)


def test_an_episode_that_ends_otherwise_or_earns_otherwise_does_not_converge():
    before, finest = np.array([[1.0, 1.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    returns = [np.zeros((1, 3)), np.zeros((1, 3)), np.array([[0.0, 0.0, 9.0]])]
    found = extrapolate([before, before, finest], returns, 4, close=5.0)
    assert found.changed.tolist() == [[False, True, True]]
    assert found.success_slack == pytest.approx(1 / 3)


def judged(rates: dict[float, float], starts: int = 100, known: bool = True) -> Panel:
    """An evaluation whose first ``rate`` episodes succeed at a step."""
    cells = {d.name: Cell.of(d, "limit", limit_part=p) for d, p in zip(STEPS, PARTS, strict=True)}
    cells = {HOME.name: Cell.of(HOME, "grid"), **cells}
    home = HOME if known else None
    rows = (
        Row.of("mine", "given", [Policy(id="mine")], home),
        Row.of("random", "baseline", [Policy(id="random")]),
    )

    def outcome(row, cell, _, k):
        mine = row.name == "mine"
        return {
            "success": mine and k < round(rates[cells[cell].dt] * starts),
            "return": (0.0 if mine else -100.0) + np.sin(k), "energy_residual_total": None,
            "energy_residual_abs_total": None, "arrival_energy": None, "arrival_residual": None,
        }  # fmt: skip

    layout = PanelLayout(rows, cells, {row.name: tuple(cells) for row in rows}, None)
    spec = {"env_id": "Pendulum-v1", "variations": []}
    return panel_of(layout, matrix_of(layout, starts, outcome), name="evaluate mine", spec=spec)


def at(home: float, half: float, quarter: float, finest: float) -> dict[float, float]:
    """Rates by step."""
    return dict(zip((HOME.dt, *(d.dt for d in STEPS)), (home, half, quarter, finest), strict=True))


def test_the_limit_takes_the_truths_place_by_its_own_name():
    panel = judged(at(1.0, 0.6, 0.5, 0.48))
    finding = finding_of(panel)
    assert panel.truth is None
    assert finding.cell == panel.limit.name == STEPS[-1].name
    assert "at the limit" in answer_lines(panel)[0]
    assert "2 of 100" in limit_words(panel)
    matrix = success_matrix(panel)
    assert (matrix.groups[0].label, matrix.groups[0].reference) == ("limit", True)
    assert panel.entry("mine", HOME.name).reference_class == "false_pass"  # type: ignore[union-attr]


def test_neither_the_page_nor_a_card_calls_the_limit_truth(tmp_path):
    panel = judged(at(1.0, 0.6, 0.5, 0.48))
    assert "at home, at the limit and on every integrator" in choice_words(panel)
    (tmp_path / "panel.json").write_bytes(msgspec.json.encode(panel))
    for card in write_cards(tmp_path, tmp_path / "cards", "me/runs").values():
        text = card.read_text(encoding="utf-8")
        assert "the limit is what" in text
        assert "truth" not in text


def test_intervals_at_the_limit_are_wider_by_the_episodes_that_still_change():
    narrow, wide = (judged(at(1.0, 0.6, quarter, 0.5)) for quarter in (0.5, 0.58))
    for one, other in zip(
        *([*panel.matrix[3:4], *panel.paired[-1:]] for panel in (narrow, wide)), strict=True
    ):
        low, high = one.success.ends
        assert other.success.ends == pytest.approx((low - 0.08, high + 0.08))
    assert wide.matrix[3].home_drop is not None


def test_nothing_is_shown_where_what_still_changes_could_undo_it():
    panel = judged(at(0.6, 0.7, 0.62, 0.52))
    lost = next(one for one in panel.paired if one.cell == STEPS[-1].name)
    assert lost.success.estimate == pytest.approx(0.08)
    assert lost.p_success == 1.0


@pytest.mark.parametrize(
    ("rates", "called"),
    [
        (at(1.0, 0.6, 0.5, 0.4), True),
        (at(1.0, 0.6, 0.5, 0.39), False),
        (at(1.0, 0.5, 0.5, 0.42), False),
        (at(1.0, 0.5, 0.5, 0.49), True),
    ],
)
def test_it_is_not_called_a_limit_where_too_many_or_ever_more_episodes_change(rates, called):
    panel = judged(rates)
    assert (panel.limit is not None) is called
    assert ("at the limit" in panel.headline) is called
    assert limit_words(panel).startswith("No limit") is not called


@pytest.mark.parametrize(("starts", "most"), [(1, "95 %"), (20, "14 %"), (50, None)])
def test_few_starts_say_what_they_may_have_missed(starts: int, most: str | None):
    told = limit_words(judged(at(1.0, 1.0, 1.0, 1.0), starts))
    assert ("of all starts" in told) is (most is not None)
    assert (most or "") in told


def test_what_is_shown_at_the_limit_exceeds_what_still_changes():
    panel = judged(at(0.8, 0.75, 0.7, 0.6))
    lost = next(one for one in panel.paired if one.cell == STEPS[-1].name)
    least = paired_success(np.repeat([1.0, 0.0], [80, 20]), np.repeat([1.0, 0.0], [70, 30]))[1]
    assert lost.success.ends[0] > 0.0
    assert lost.p_success == pytest.approx(least)


@pytest.mark.parametrize("rate", [0.4, 0.39])
def test_the_finest_step_is_told_as_it_is_where_it_is_not_called_a_limit(rate):
    panel = judged(at(rate, 0.6, 0.5, rate))
    home, finest = (panel.entry("mine", name) for name in (HOME.name, STEPS[-1].name))
    assert (finest.success == home.success) is (panel.limit is None)
    (lost,) = (one for one in panel.paired if one.cell == STEPS[-1].name)
    assert (lost.success.ends[1] < 0.1) is (panel.limit is None)


def test_no_claim_is_shown_in_the_coarser_steps_of_a_limit():
    panel = judged(at(1.0, 0.2, 1.0, 1.0))
    assert parse_claim("success < 0.5").find_support(panel) is None
    assert parse_claim("success < 0.5").find_support(judged(at(1.0, 0.2, 0.2, 0.2))) is not None


def test_of_several_limits_the_one_that_converges_least_is_told():
    panel = judged(at(1.0, 0.6, 0.5, 0.48))
    own, random = panel.limits
    slower = msgspec.structs.replace(own, not_converged=60)
    told = msgspec.structs.replace(panel, limits=(own, slower, random))
    assert told.limit is None
    assert limit_words(told).startswith("No limit")


def test_a_policy_of_unknown_home_is_held_against_the_limit():
    settled, changing = (judged(at(0.8, 0.6, q, 0.5), known=False) for q in (0.5, 0.57))
    for one, other in zip(settled.paired, changing.paired, strict=True):
        assert one.against == other.against == "limit"
        low, high = one.success.ends
        assert other.success.ends == pytest.approx((low - 0.07, high + 0.07))


@pytest.mark.slow
def test_an_evaluation_without_a_truth_has_a_limit_that_verify_makes_again(tmp_path, capsys):
    out = tmp_path / "run"
    chosen = ["--home", "stock", "--dt", "0.05", "--episodes", "4", "--no-progress"]
    policy = ["--policy", f"{__name__}:still", "--env", "Pendulum-v1", "--out", str(out)]
    assert main(["evaluate", *policy, *chosen, "--no-limit"]) == 0
    assert read_panel(out / "panel.json").limits == ()
    assert main(["evaluate", *policy, *chosen]) == 0
    panel = read_panel(out / "panel.json")
    assert {one.row for one in panel.limits} == {row.name for row in panel.rows}
    assert "limit" in capsys.readouterr().out
    assert main(["evidence", "verify", str(out), "--own-code"]) == 0
    path = out / "panel.json"
    told = json.loads(path.read_text(encoding="utf-8"))
    told["limits"][0]["not_converged"] += 1
    path.write_text(json.dumps(told), encoding="utf-8")
    assert main(["evidence", "verify", str(out), "--own-code"]) == 1


def still(observation):
    """No torque."""
    return np.zeros(1, np.float32)
