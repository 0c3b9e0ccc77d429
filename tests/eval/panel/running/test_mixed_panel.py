"""Panels with a mixture: the specification, both trainers end to end, resuming."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from engine_cases import needs
from small_panel import bare_data, small_data

from integ_gym import run_panel
from integ_gym.cli import main
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.settings import Discretization
from integ_gym.eval.panel.cells import Cell, DiscretizationMixture, SpecError, training_arguments
from integ_gym.eval.panel.episodes import Subject, evaluate
from integ_gym.eval.panel.existing import Evaluation
from integ_gym.eval.panel.run import check_spec
from integ_gym.eval.panel.spec import PanelSpec, parse_spec
from integ_gym.eval.panel.units import training_config, units_of
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.baselines import make_baseline
from integ_gym.train.policy_files.card import hashed
from integ_gym.train.policy_files.sidecar import read_sidecar

MEMBERS = ["explicit_euler dt=0.05", "rk4 dt=0.05", "rk4 dt=0.025"]
SHARES = dict(zip(MEMBERS, (0.5, 0.25, 0.25), strict=True))


COARSE = {"integrator": "explicit_euler", "dt": 0.05}
MIXTURE = {
    "mixture": "both",
    "members": [{**COARSE, "weight": 2}, {"integrator": "rk4", "dt": [0.05, 0.025]}],
}


def _data(**changes):
    data = small_data(
        trainer="fleet", baselines=["handmade"], family=[["both", "reference dt=0.05"]],
        compare=[["both", "explicit_euler dt=0.05"]], train=[COARSE, MIXTURE],
        evaluate=[{"integrator": ["explicit_euler", "rk4"], "dt": [0.05, 0.025, 0.0125]}],
        environment={"start": "hanging", "max_torque": 1.0, "duration": 2.0},
        training={"total_steps": 1024, "n_steps": 32},
    )  # fmt: skip
    return {**data, "perturbations": data["perturbations"][:1], **changes}


def _train(**changes):
    """The specification with its mixture changed; None leaves a key out."""
    changed = {k: x for k, x in {**MIXTURE, **changes}.items() if x is not None}
    return _data(train=[COARSE, changed])


def test_a_mixture_is_one_row_evaluated_at_its_members_first():
    spec = parse_spec(_data(), "test")
    check_spec(spec)
    single, mixture = spec.train
    assert isinstance(single, Discretization)
    assert (mixture.name, mixture.control_period) == ("both", 0.05)
    assert {d.name: share for d, share in mixture.shares.items()} == SHARES
    cells = spec.cells_of(mixture)
    names = [cell.name for cell in cells]
    assert set(names[:3]) == set(MEMBERS)
    assert names[3:7] == [
        "explicit_euler dt=0.025", "explicit_euler dt=0.0125", "rk4 dt=0.0125", "reference dt=0.05",
    ]  # fmt: skip
    assert names[7:] == [f"{name}, mass +20 %" for name in (*MEMBERS, "reference dt=0.05")]
    rows = {unit.row: unit for unit in units_of(spec)}
    assert rows["both"].policy == "both-seed1"
    arguments = training_config(spec, rows["both"]).env_arguments
    assert arguments == {
        "start": "hanging", "max_torque": 1.0, "duration": 2.0, "control_period": 0.05,
        "mixture": [
            {"engine": "native", "integrator": "explicit_euler", "dt": 0.05, "weight": 2.0},
            {"engine": "native", "integrator": "rk4", "dt": 0.05, "weight": 1.0},
            {"engine": "native", "integrator": "rk4", "dt": 0.025, "weight": 1.0},
        ],
    }  # fmt: skip
    stated = json.loads(json.dumps(spec.to_json()))["train"][1]
    assert stated["mixture"] == "both"
    assert [(m["integrator"], m["dt"], m["weight"]) for m in stated["members"]] == [
        ("explicit_euler", 0.05, 2.0), ("rk4", 0.05, 1.0), ("rk4", 0.025, 1.0),
    ]  # fmt: skip


@pytest.mark.slow
def test_the_examples_of_the_documentation_are_valid():
    page = Path(__file__).parents[4] / "docs" / "reference" / "panel.md"
    examples = re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    first, example, evaluation, task = examples
    assert msgspec.convert(tomllib.loads(evaluation), Evaluation).limit
    needs("mujoco")
    for alone in (first, task):
        check_spec(parse_spec(tomllib.loads(alone), "docs/reference/panel.md"))
    spec = parse_spec(tomllib.loads(example), "docs/reference/panel.md")
    check_spec(replace(spec, trainer="fleet"))
    assert [home.name for home in spec.train] == [
        "explicit_euler dt=0.05", "reference dt=0.05", "mixed",
    ]  # fmt: skip


def test_a_reference_in_a_mixture_takes_a_step_that_delays_are_multiples_of():
    members = [{"integrator": "reference", "dt": 0.05}, {"integrator": "rk4", "dt": 0.0125}]
    data = _train(members=members)
    data |= {"family": [], "compare": [], "environment": {"action_latency": 0.0125}}
    data |= {"train": data["train"][1:], "evaluate": [{"integrator": "rk4", "dt": 0.0125}]}
    spec = parse_spec(data, "test")
    (mixture,) = spec.train
    arguments = training_arguments(mixture, spec.environment)
    assert [member["dt"] for member in arguments["mixture"]] == [0.0125, 0.0125]


@pytest.mark.parametrize(
    ("data", "fragments"),
    [
        (_train(members=[]), ["mixture 'both' needs at least two `members`, got 0"]),
        (_train(members=None), ["missing required field `members`", "`train[1]`"]),
        (_train(members=[{"integrator": "rk4", "dt": 0.05}]), ["got 1", "without a mixture"]),
        (
            _train(members=[{"integrator": "rk5", "dt": [0.05, 0.025]}]),
            ["unknown integrator 'rk5'", "Did you mean 'rk4'"],
        ),
        (
            _train(members=[{"integrator": "rk4", "dt": [0.05, 0.025], "weight": -1}]),
            ["Expected `float` > 0.0", "`train[1].members[0].weight`"],
        ),
        (_train(members=[{"integrator": "rk4", "dt": 0.05}] * 2), ["`members of both` lists"]),
        (
            _train(members=[{"integrator": "rk4", "dt": [0.05, 0.0025]}]),
            ["'rk4 dt=0.0025' is not; add it to `evaluate`"],
        ),
        (_train(mixture="handmade"), ["lists something twice: handmade"]),
        (_train(mixture="explicit_euler-dt-0.05"), ["twice: explicit_euler-dt-0.05"]),
        (_data(family=[["both", "rk4 dt=0.025"]]), ["its own home 'rk4 dt=0.025'"]),
        (
            _data(evaluate=[{"integrator": ["explicit_euler", "rk4"], "dt": [0.05, 0.025]}]),
            ["`compare` needs rk4 evaluated at dt=0.0125 or finer, a quarter of rk4 dt=0.05's"],
        ),
    ],
)  # fmt: skip
def test_impossible_mixtures_name_the_remedy(data, fragments):
    data = {**data, "family": [], "compare": []} if data["train"] != _data()["train"] else data
    with pytest.raises(SpecError) as caught:
        check_spec(parse_spec(data, "panel.toml"))
    for fragment in fragments:
        assert fragment in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_fleet_refuses_shares_that_are_no_whole_environments():
    thirds = [{"integrator": name, "dt": 0.05} for name in ("explicit_euler", "rk4", "reference")]
    data = {**_train(members=thirds), "family": [], "compare": [], "trainer": "fleet"}
    with pytest.raises(SpecError, match=r"16 environments .*explicit_euler 1/3.* multiple of 3"):
        check_spec(parse_spec(data, "panel.toml"))
    check_spec(parse_spec({**data, "trainer": "sb3"}, "panel.toml"))


@pytest.fixture(scope="module")
def finished(made_once):
    """What trainers differ in ends with the policies; here stable-baselines3's."""

    def make(folder):
        run_panel(
            parse_spec(_data(trainer="sb3"), "test"), folder / "out", workers=1, progress=False
        )

    return made_once("mixed", make) / "out"


def _panel(directory):
    return json.loads((directory / "panel.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_home_of_the_mixture_is_its_members_by_their_shares(finished):
    panel = _panel(finished)
    entries = {(e["row"], e["cell"]): e for e in panel["matrix"]}
    row = next(row for row in panel["rows"] if row["name"] == "both")
    assert (row["home"], row["integrator"], row["dt"]) == (None, None, None)
    assert (row["shares"], row["control_period"]) == (SHARES, 0.05)
    rates = [
        share * np.array(entries["both", cell]["success_by_seed"]) for cell, share in SHARES.items()
    ]
    home = np.sum(rates, axis=0)
    assert row["home_success"]["estimate"] == pytest.approx(home.mean())
    assert row["learned"] == bool(home.mean() >= 0.5)
    for cell in (*MEMBERS, "reference dt=0.05"):
        there = np.mean(entries["both", cell]["success_by_seed"])
        assert entries["both", cell]["home_drop"]["estimate"] == pytest.approx(home.mean() - there)
    assert entries["both", "explicit_euler dt=0.05"]["transfer_gap"] is not None
    assert entries["both", "rk4 dt=0.05"]["transfer_gap"] is None
    assert [v["row"] for v in panel["verdicts"]] == ["both"]
    assert panel["verdicts"][0]["verdict"] in ("inconclusive", "not_learned")
    assert panel["policy_comparisons"][0]["a"] == "both"
    (remedy,) = panel["remedies"]
    assert [cell["cell"] for cell in remedy["cells"] if cell["member"]] == MEMBERS
    assert {n: len(cost["by_seed"]) for n, cost in panel["training_costs"].items()} == {
        "explicit_euler dt=0.05": 2, "both": 2,
    }  # fmt: skip


@pytest.mark.slow
def test_a_policy_of_a_mixture_can_be_evaluated_by_itself(finished, tmp_path, capsys):
    policy = finished / "policies" / "both-seed0" / "policy.zip"
    command = ["evaluate", str(policy), "--env", "IntegPendulum-v0", "--out", str(tmp_path / "out")]
    grid = ["--integrator", "rk4", "--dt", "0.05", "--episodes", "2", "--no-progress"]
    assert main([*command, *grid]) == 0
    panel = _panel(tmp_path / "out")
    row = panel["rows"][0]
    assert (row["kind"], row["home"], row["shares"]) == ("given", None, SHARES)
    columns = [c["name"] for c in panel["cells"] if c["kind"] in ("grid", "reference")]
    assert set(columns) == {*MEMBERS, "reference dt=0.05"}
    labels = {label for entry in panel["matrix"] for label in entry["labels"]}
    assert "unattributed" not in labels
    assert panel["remedies"] == []
    capsys.readouterr()
    assert main([*command[:-1], str(tmp_path / "no"), "--env-arg", "mixture=[]", *grid]) == 2
    assert "`mixture` is what the evaluation varies" in capsys.readouterr().err


@pytest.mark.slow
def test_a_side_car_with_a_mixture_runs_no_code_unasked(finished, tmp_path, capsys):
    source = finished / "policies" / "both-seed0"
    for name in ("policy.zip", "policy.json"):
        (tmp_path / name).write_bytes((source / name).read_bytes())
    card = json.loads((tmp_path / "policy.json").read_text())
    command = ["evaluate", str(tmp_path / "policy.zip"), "--env", "IntegPendulum-v0"]
    for members, fragment in (
        ([{"integrator": "secret_module:Heun", "dt": 0.05}], "pass --own-code"),
        (["rk4"], "every member of `mixture`"),
        (3, "must be a list"),
    ):
        card["config"]["env_arguments"]["mixture"] = members
        (tmp_path / "policy.json").write_text(json.dumps(hashed(card)))
        assert main([*command, "--out", str(tmp_path / "out")]) == 2
        assert fragment in capsys.readouterr().err


def test_a_failure_is_the_discretizations_where_any_member_succeeds(tmp_path):
    """Handmade control: never fails on RK4, takes two horizons on implicit Euler at 0.025, and
    never succeeds at 0.05."""
    names = ("rk4", 0.05), ("implicit_euler", 0.025), ("implicit_euler", 0.05)
    rk4, fine, coarse = (Discretization(name, dt, 0.05) for name, dt in names)
    environment = {"start": "hanging", "max_torque": 0.7, "duration": 12.0}
    setup = environment_setup("IntegPendulum-v0", {**environment, **rk4.arguments()})
    home = DiscretizationMixture("both", ((rk4, 1.0), (fine, 1.0)))
    cells = tuple(Cell.of(d, "grid") for d in (rk4, fine, coarse))
    subject = Subject(make_baseline("handmade", setup), cells, home)
    store = EvidenceStore(tmp_path)
    spec = PanelSpec(
        name="run", env_id="IntegPendulum-v0", control_period=0.05, train=(), grid=(), seeds=(),
        environment=environment,
    )  # fmt: skip
    store.commit_all("batch", evaluate(spec, [subject], range(6), store, {}))
    labels = {d.name: {} for d in (rk4, fine, coarse)}
    for record in store.records():
        if record["phase"] != "evaluation":
            continue
        count = labels[record["cell"]]
        count[record["failure_label"]] = count.get(record["failure_label"], 0) + 1
        if record["failure_label"] == "discretization_error":
            assert "on a training discretization of it" in record.reason
    assert labels[rk4.name] == {"none": 6}
    assert labels[fine.name] == {"too_slow": 6}
    assert labels[coarse.name] == {"discretization_error": 6}


BOTH = {
    "mixture": "both",
    "members": [
        {"integrator": "rk4", "dt": 0.05, "control_period": [0.05, 0.1]},
        {"integrator": "explicit_euler", "dt": 0.05, "control_period": 0.1, "weight": 2},
    ],
}
JUDGED = [
    {"integrator": ["rk4", "explicit_euler"], "dt": 0.05, "control_period": [0.05, 0.1]},
    {"integrator": "rk4", "dt": 0.025},
]
PERIOD_SHARES = {
    "rk4 dt=0.05": 0.25,
    "rk4 dt=0.05 control=0.1": 0.25,
    "explicit_euler dt=0.05 control=0.1": 0.5,
}


def _spec(**changes):
    own = {"trainer": "fleet", "seeds": [0, 1], "ladder": True, "train": [BOTH["members"][0], BOTH]}
    own |= {"evaluate": JUDGED, "family": [["both", "rk4 dt=0.025"]]}
    own |= {"perturbations": [{"name": "late", "environment": {"action_latency": 0.05}}]}
    own |= {"environment": {"start": "hanging", "max_torque": 1.0, "duration": 2.0}}
    own |= {"training": {"total_steps": 512, "n_steps": 32}}
    return parse_spec(bare_data({}, **{**own, **changes}), "test")


@pytest.mark.parametrize("trainer", ["fleet", "sb3"])
def test_rows_have_their_control_periods_and_the_truth_at_each(trainer):
    spec = _spec(trainer=trainer)
    check_spec(spec)
    slow, mixture = spec.train[1:]
    assert [spec.name_of(home) for home in spec.train] == [
        "rk4 dt=0.05", "rk4 dt=0.05 control=0.1", "both",
    ]  # fmt: skip
    assert mixture.control_period is None
    assert spec.shares_of(mixture) == PERIOD_SHARES
    truths = {cell.name: cell.control_period for cell in spec.columns() if cell.reference}
    assert truths == {"reference dt=0.05": 0.05, "reference dt=0.1 control=0.1": 0.1}
    late = {cell.at for cell in spec.cells_of(slow) if cell.variation == "late"}
    assert late == {"rk4 dt=0.05 control=0.1", "reference dt=0.1 control=0.1"}
    late = {cell.at for cell in spec.cells_of(mixture) if cell.variation == "late"}
    assert late == {*PERIOD_SHARES, *truths}
    ladder = [cell.dt for cell in spec.cells_of(slow) if cell.kind == "ladder"]
    assert ladder == [0.025, 0.0125]
    trained = [unit for unit in units_of(spec) if unit.home is not None]
    units = {unit.row: training_config(spec, unit).env_arguments for unit in trained}
    assert units["rk4 dt=0.05 control=0.1"]["control_period"] == 0.1
    assert "control_period" not in units["both"]
    members = [(m["control_period"], m["weight"]) for m in units["both"]["mixture"]]
    assert members == [(0.05, 1.0), (0.1, 1.0), (0.1, 2.0)]


def test_what_is_trained_at_a_control_period_is_evaluated_at_it():
    evaluated = [{"integrator": ["rk4", "explicit_euler"], "dt": [0.05, 0.025]}]
    with pytest.raises(SpecError, match=r"'rk4 dt=0.05 control=0.1' is not; add it to `evaluate`"):
        _spec(evaluate=evaluated)


@pytest.fixture(scope="module")
def finished_periods(made_once):
    def make(folder):
        run_panel(_spec(), folder / "out", workers=1, progress=False)

    return made_once("periods", make) / "out"


@pytest.mark.slow
def test_a_panel_of_several_control_periods_is_played_again_to_the_last_bit(finished_periods):
    store = EvidenceStore(finished_periods / "evidence")
    assert store.verify() == []
    found = store.query(
        "SELECT cell, phase, control_period, max(length) AS length FROM records "
        "WHERE phase IN ('evaluation', 'training') GROUP BY ALL"
    ).to_pylist()
    periods = {row["cell"]: row["control_period"] for row in found if row["phase"] == "evaluation"}
    panel = json.loads((finished_periods / "panel.json").read_text(encoding="utf-8"))
    own = {cell["name"]: cell["control_period"] for cell in panel["cells"]}
    assert periods == {name: own[name] for name in periods}
    assert set(PERIOD_SHARES) < set(periods)
    assert all(row["length"] == round(2.0 / row["control_period"]) for row in found)
    rows = {row["name"]: row for row in panel["rows"]}
    assert rows["both"]["shares"] == PERIOD_SHARES
    assert {name: row["control_period"] for name, row in rows.items()} == {
        "rk4 dt=0.05": 0.05, "rk4 dt=0.05 control=0.1": 0.1, "both": None, "zero": None,
    }  # fmt: skip
    card = read_sidecar(finished_periods / "policies" / "both-seed0" / "policy.zip")
    assert card["derived"]["gamma"] == pytest.approx(np.exp([-0.05, -0.1, -0.1]))
    assert main(["evidence", "verify", str(finished_periods), "--exact"]) == 0
