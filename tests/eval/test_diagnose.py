"""`integ-gym diagnose`: what it measures, what it expects, what it writes."""

from __future__ import annotations

import contextlib
import io
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from integ_gym.cli import main
from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.envs.numerics import advance
from integ_gym.envs.plants import PLANTS
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.eval import drift_example
from integ_gym.eval.diagnosis.bench import Bench, Commands
from integ_gym.eval.diagnosis.impact import impact_of
from integ_gym.eval.diagnosis.run import SECTIONS
from integ_gym.eval.diagnosis.subject import subjects
from integ_gym.eval.diagnosis.theory import THEORY
from integ_gym.evidence.store import EvidenceStore

BUILT_IN = "symplectic_euler"
PLANTED = ("planted:Boaster", "planted:Silent")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Directory, result and terminal output of a small diagnosis."""
    out = tmp_path_factory.mktemp("diagnose") / "run"
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        code = main(
            ["diagnose", "--plant", "pendulum", "--integrator", BUILT_IN, "reference", *PLANTED,
             "--out", str(out), "--workers", "1", "--no-progress"]
        )  # fmt: skip
    assert code == 0
    result: dict[str, Any] = json.loads((out / "diagnose.json").read_text(encoding="utf-8"))
    return out, result, printed.getvalue()


def _lines(result: dict[str, Any], integrator: str, quantity: str) -> list[dict[str, Any]]:
    return [
        line
        for line in result["findings"]
        if line["integrator"] == integrator and quantity in line["quantity"]
    ]


def test_every_section_has_lines_with_measured_expected_and_verdict(run):
    _, result, _ = run
    assert {line["section"] for line in result["findings"]} == set(SECTIONS)
    for line in result["findings"]:
        assert set(line) == {
            "section", "plant", "integrator", "quantity", "measured", "unit", "expected", "holds",
            "steps",
        }  # fmt: skip
        assert line["holds"] in (True, False, None)
        assert line["quantity"]
        assert line["expected"]
        assert isinstance(line["measured"], (str, list))
        assert line["measured"]


def test_result_describes_the_run(run):
    out, result, _ = run
    assert result["schema_version"] == 1
    assert result["command"].startswith("integ-gym diagnose --plant pendulum")
    (plant,) = result["plants"]
    assert plant["name"] == "pendulum"
    assert plant["dt_s"] == [0.05, 0.025, 0.0125]
    assert plant["frequency_rad_s"] == pytest.approx(math.sqrt(15.0))
    assert plant["rest_state"] == pytest.approx([math.pi, 0.0])
    assert result["records"] == EvidenceStore(out / "evidence").count() > 100


def test_evidence_is_sound(run):
    out, _, _ = run
    store = EvidenceStore(out / "evidence")
    assert store.verify() == []
    phases = store.query("SELECT DISTINCT phase FROM records").to_pylist()
    assert phases == [{"phase": "evaluation"}]


def test_figures_are_written(run):
    out, _, _ = run
    names = {path.name for path in (out / "figures").glob("*.png")}
    assert names == {
        "energy.png", "phase_portraits.png", "stability.png", "contact_stability.png",
        "convergence.png", "work_precision.png",
    }  # fmt: skip


def test_claims_of_a_planted_integrator_are_refuted(run):
    _, result, _ = run
    for quantity in ("order of convergence", "symplectic: ", "reversible: ", "energy gained"):
        (line,) = _lines(result, "planted:Boaster", quantity)
        assert line["holds"] is False, quantity
    (drift,) = _lines(result, "planted:Boaster", "energy change after")
    assert drift["expected"].startswith("bounded")
    assert drift["holds"] is False


def test_an_integrator_that_says_nothing_is_told_what_it_is(run):
    _, result, printed = run
    for line in _lines(result, "planted:Silent", "order of convergence"):
        assert line["measured"] == [pytest.approx(1.0, abs=0.05)]
        assert line["holds"] is None
    told = (
        "planted:Silent: order 1.00, not symplectic, not reversible, "
        "makes oscillations grow at every step size"
    )
    assert told in [x["is"] for x in result["integrators"]]
    assert told in printed


def test_built_in_integrator_keeps_its_promises(run):
    _, result, _ = run
    for quantity in ("order", "symplectic: ", "reversible: ", "energy gained", "stable up to"):
        found = _lines(result, BUILT_IN, quantity)
        assert found
        for line in found:
            assert line["holds"] is True, line


def test_the_truth_holds_everywhere(run):
    _, result, _ = run
    for line in result["findings"]:
        if line["integrator"] == "reference":
            assert line["holds"] is not False, line


def test_table_says_what_does_not_hold(run):
    _, result, printed = run
    failed = [line for line in result["findings"] if line["holds"] is False]
    asked = [line for line in result["findings"] if line["holds"] is not None]
    assert f"{len(asked) - len(failed)} of {len(asked)} expectations hold." in printed
    assert "These do not:" in printed


def test_a_diagnosis_is_not_overwritten(run, capsys):
    out, _, _ = run
    assert main(["diagnose", "--plant", "pendulum", "--out", str(out)]) == 2
    assert "already holds a diagnosis" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--plant", "pendulm"], "Did you mean 'pendulum'"),
        (["--plant", "nowhere:Plant"], 'write it as "module:Class"'),
        (["--plant", "planted:NoPlant"], "lacks name, coordinates"),
        (["--integrator", "rk5"], "unknown integrator 'rk5'"),
        (["--plant", "pendulum", "--dt", "-0.1"], "--dt must be a finite number"),
        (["--plant", "pendulum", "--dt", "nan"], "--dt must be a finite number"),
        (["--env", "IntegPendulum-v0", "--plant", "pendulum"], "not both"),
        (["--plant", "pendulum", "--dt", "0.05", "0.03"], "not a whole multiple"),
        (["--plant", "pendulum", "--workers", "0"], "--workers must be 1 or above"),
        (["--example", "drift", "--plant", "pendulum"], "leave --plant out"),
    ],
)
def test_bad_input_ends_with_one_line(arguments, message, tmp_path, capsys):
    command = ["diagnose", *arguments, "--out", str(tmp_path / "out"), "--no-progress"]
    assert main(command) == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out" / "diagnose.json").exists()


def test_theory_covers_the_built_in_integrators():
    assert set(THEORY) == set(INTEGRATORS.names())


def test_records_of_different_plants_are_different(tmp_path):
    bench = Bench(EvidenceStore(tmp_path), "run")
    for subject in subjects(None, None, []):
        bench.open_loop(
            "cell", subject, "rk4", subject.steps[0], Commands("zero", np.zeros(1)),
            subject.start[None], duration=2.0 * subject.steps[0],
        )  # fmt: skip
    bench.commit("section")
    assert bench.store.count() == len(PLANTS.names())
    assert bench.store.verify() == []


@pytest.mark.parametrize("name", PLANTS.names())
def test_rest_is_an_equilibrium(name):
    (subject,) = subjects(None, name, [])
    moved = advance("reference", subject.plant, subject.rest, 1.0)
    assert np.abs(moved - subject.rest).max() < 1e-8


@pytest.mark.parametrize("name", PLANTS.names())
def test_analytic_impact_is_what_the_plant_does(name):
    """Penetration and rebound of one impact, against the motion followed to rounding."""
    (subject,) = subjects(None, name, [])
    impact = impact_of(subject)
    if impact is None:
        assert not hasattr(subject.plant, "stopped")
        return
    plant = subject.varied(**impact.arguments)
    place = 2 * plant.stopped
    states = [impact.start]
    for _ in range(600):
        states.append(advance("reference", plant, states[-1], 1e-3))
    path = np.array(states)
    deepest = path[:, place].max() - 2.0
    assert deepest == pytest.approx(impact.penetration(impact.stiffness), rel=1e-3)
    assert path[-1, place + 1] == pytest.approx(-math.sqrt(impact.rebound), rel=1e-8)


def test_drift_example(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(drift_example, "CART_POLE_TIMES", (10.0,))
    assert main(["diagnose", "--example", "drift", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    for number in ("−0.7968 %", "+3.585·10⁴ %", "−0.07413 %", "−3.435 %"):
        assert number in printed
    assert (tmp_path / "drift.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("plant", "fragment"),
    [
        ("own_plants:CentralSpring", "`mass` of the plant 'own_plants:CentralSpring' has no unit"),
        (f"{__name__}:Loose", "has no restoring force"),
        (f"{__name__}:Scalar", "write its equations with the `ops`"),
    ],
)
def test_a_plant_that_cannot_be_diagnosed_is_refused_in_one_line(
    plant, fragment, tmp_path, capsys, monkeypatch
):
    monkeypatch.syspath_prepend(Path(__file__).parent.parent / "envs")
    assert main(["diagnose", "--plant", plant, "--out", str(tmp_path / "o")]) == 2
    error = capsys.readouterr().err
    assert fragment in error
    assert error.count("\n") == 1
    assert not (tmp_path / "o").exists()


def test_a_step_that_would_take_too_many_is_refused(tmp_path, capsys):
    command = ["diagnose", "--plant", "pendulum", "--dt", "1e-7", "--out", str(tmp_path / "o")]
    assert main(command) == 2
    assert "give a larger one" in capsys.readouterr().err


@dataclass(frozen=True)
class Loose(Pendulum):
    """A pendulum that nothing pulls back."""

    def acceleration(self, ops, q, v, force):
        return (force[0] / self.inertia - 0.0 * q[0],)


@dataclass(frozen=True)
class Scalar(Pendulum):
    """A pendulum whose equations take floats alone."""

    def acceleration(self, ops, q, v, force):
        return (self.gravity_torque / self.inertia * math.sin(q[0]),)
