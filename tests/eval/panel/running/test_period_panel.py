"""Panels whose rows decide at other control periods than the panel, alone or in a mixture."""

from __future__ import annotations

import json

import numpy as np
import pytest
from small_panel import bare_data

from integ_gym import run_panel
from integ_gym.cli import main
from integ_gym.eval.panel.cells import SpecError
from integ_gym.eval.panel.run import check_spec
from integ_gym.eval.panel.spec import parse_spec
from integ_gym.eval.panel.units import training_config, units_of
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy_files.sidecar import read_sidecar

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
SHARES = {
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
    assert spec.shares_of(mixture) == SHARES
    truths = {cell.name: cell.control_period for cell in spec.columns() if cell.reference}
    assert truths == {"reference dt=0.05": 0.05, "reference dt=0.1 control=0.1": 0.1}
    late = {cell.at for cell in spec.cells_of(slow) if cell.variation == "late"}
    assert late == {"rk4 dt=0.05 control=0.1", "reference dt=0.1 control=0.1"}
    late = {cell.at for cell in spec.cells_of(mixture) if cell.variation == "late"}
    assert late == {*SHARES, *truths}
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
def finished(made_once):
    def make(folder):
        run_panel(_spec(), folder / "out", workers=1, progress=False)

    return made_once("periods", make) / "out"


@pytest.mark.slow
def test_a_panel_of_several_control_periods_is_played_again_to_the_last_bit(finished):
    store = EvidenceStore(finished / "evidence")
    assert store.verify() == []
    found = store.query(
        "SELECT cell, phase, control_period, max(length) AS length FROM records "
        "WHERE phase IN ('evaluation', 'training') GROUP BY ALL"
    ).to_pylist()
    periods = {row["cell"]: row["control_period"] for row in found if row["phase"] == "evaluation"}
    panel = json.loads((finished / "panel.json").read_text(encoding="utf-8"))
    own = {cell["name"]: cell["control_period"] for cell in panel["cells"]}
    assert periods == {name: own[name] for name in periods}
    assert set(SHARES) < set(periods)
    assert all(row["length"] == round(2.0 / row["control_period"]) for row in found)
    rows = {row["name"]: row for row in panel["rows"]}
    assert rows["both"]["shares"] == SHARES
    assert {name: row["control_period"] for name, row in rows.items()} == {
        "rk4 dt=0.05": 0.05, "rk4 dt=0.05 control=0.1": 0.1, "both": None, "zero": None,
    }  # fmt: skip
    card = read_sidecar(finished / "policies" / "both-seed0" / "policy.zip")
    assert card["derived"]["gamma"] == pytest.approx(np.exp([-0.05, -0.1, -0.1]))
    assert main(["evidence", "verify", str(finished), "--exact"]) == 0
