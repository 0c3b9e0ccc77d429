"""`integ-gym diagnose`: what it measures, what it expects, what it writes."""

from __future__ import annotations

import errno
import io
import json
import math
import os
import re
from dataclasses import dataclass

import numpy as np
import pytest
from examining import RESTING
from house import ROOT, page_blocks
from planted import Falling, Hill, Slider

from integ_gym.cli import main
from integ_gym.envs.numerics.stepping import advance
from integ_gym.envs.plants.elastic_pendulum import ElasticPendulum
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.plants.quadrotor import Quadrotor
from integ_gym.envs.registries import INTEGRATORS
from integ_gym.eval.diagnosis import drift, identity, run
from integ_gym.eval.diagnosis.bench import Bench
from integ_gym.eval.diagnosis.contact import impact_of, sweep_approach
from integ_gym.eval.diagnosis.page import print_diagnosis
from integ_gym.eval.diagnosis.run import SECTIONS
from integ_gym.eval.diagnosis.subject import rest_state, subjects, theory_of
from integ_gym.evidence.store import EvidenceStore

BUILT_IN = "symplectic_euler"
PLANTED = ("planted:Boaster", "planted:Silent")


def test_result_describes_the_run(diagnosis):
    out, result, _ = diagnosis
    assert {line["section"] for line in result["findings"]} == set(SECTIONS)
    for line in result["findings"]:
        assert all(line[key] for key in ("quantity", "shown", "expected", "tolerance")), line
        assert line["measured"] or line["order_steps"]
        assert (line["tolerance"] == "-") is (line["holds"] is None), line
        assert line["integrator"] != "reference" or line["holds"] is not False, line
    assert result["command"].startswith("integ-gym diagnose --plant pendulum")
    (plant,) = result["plants"]
    assert plant["name"] == "pendulum"
    assert plant["dt_s"] == [0.05, 0.025, 0.0125]
    assert plant["frequency_rad_s"] == pytest.approx(math.sqrt(15.0))
    assert plant["rest_state"] == pytest.approx([math.pi, 0.0])
    assert result["integrators"] == [BUILT_IN, "reference", *PLANTED]
    assert result["records"] == EvidenceStore(out / "evidence").count() > 1000


def test_evidence_is_sound_and_holds_every_point_of_the_convergence_curve(diagnosis):
    out, result, _ = diagnosis
    store = EvidenceStore(out / "evidence")
    assert store.verify() == []
    phases = store.query("SELECT DISTINCT phase FROM records").to_pylist()
    assert phases == [{"phase": "evaluation"}]
    units = store.query(
        "SELECT DISTINCT json_extract_string(arguments, '$.control_limit.unit') AS unit "
        "FROM records WHERE env_id = 'OpenLoop-pendulum'"
    ).to_pylist()
    assert units == [{"unit": "N m"}]
    query = "SELECT DISTINCT dt FROM records WHERE integrator = '{}' AND cell LIKE '%refinement/%'"
    for curve in result["curves"]["refinement"]:
        recorded = {row["dt"] for row in store.query(query.format(curve["integrator"])).to_pylist()}
        assert set(curve["steps"]) <= recorded


def test_an_integrator_that_says_nothing_is_told_what_it_is(diagnosis):
    _, result, printed = diagnosis
    (line,) = (
        line
        for line in result["findings"]
        if (line["integrator"], line["quantity"][:5]) == ("planted:Silent", "order")
    )
    assert line["order"] == pytest.approx(1.0, abs=0.05)
    assert line["holds"] is None
    (told,) = [x for x in result["identities"] if x["integrator"] == "planted:Silent"]
    assert told["order"] == pytest.approx(1.0, abs=0.05)
    assert (told["symplectic"], told["reversible"]) == (False, False)
    assert (told["stable_up_to_h_omega"], told["stable_up_to_dt_s"]) == (0.0, 0.0)
    assert f"pendulum planted:Silent 1.00 no no {told['stable']}" in " ".join(printed.split())


def test_nothing_is_said_of_what_does_not_hold_where_all_does(diagnosis):
    _, result, printed = diagnosis
    assert "NO" in printed.split()
    holding = [line for line in result["findings"] if line["holds"] is not False]
    told = io.StringIO()
    print_diagnosis({**result, "findings": holding}, told, every_line=True)
    count = sum(line["holds"] is True for line in holding)
    assert f"\n{count} of {count} expectations hold.\n" in told.getvalue()
    assert not re.search(r"\bNO\b|not hold", told.getvalue())


def _plain(row: str) -> str:
    """A row without its blanks, and without what rounding alone decides."""
    return re.sub(r"[\d.]+·10⁻¹[⁰¹²³⁴⁵⁶⁷⁸⁹](?= )", "rounding", " ".join(row.split()))


def test_the_documented_table_is_what_is_printed(diagnosis):
    rows = {_plain(row) for row in diagnosis[2].splitlines()}
    (block,) = page_blocks("docs/reference/diagnose.md", "text")
    checked = [_plain(row) for row in block.splitlines() if row.strip("- ")]
    assert len(checked) > 15
    for row in checked:
        assert row in rows


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--plant", "pendulm"], "Did you mean 'pendulum'"),
        (["--plant", "nowhere:Plant"], 'write it as "module:Class"'),
        (["--plant", "planted:NoPlant"], "lacks name, coordinates"),
        (["--integrator", "rk5"], "unknown integrator 'rk5'"),
        (["--plant", "pendulum", "--dt", "nan"], "--dt must be a finite number"),
        (["--env", "IntegPendulum-v0", "--plant", "pendulum"], "not both"),
        (["--plant", "pendulum", "--dt", "0.05", "0.03"], "not a whole multiple"),
        (["--plant", "pendulum", "--workers", "0"], "--workers must be 1 or above"),
        (["--example", "drift", "--plant", "pendulum"], "--plant has no effect; leave it out"),
        (["--example", "drift", "--dt", "0.03"], "nearest valid"),
        (["--example", "drift", "--dt", "0.1", "0.05"], "takes one step"),
        (["--plant", "own_plants:CentralSpring"], "`mass` of the plant 'own_plants:CentralSpring'"),
        (["--plant", f"{__name__}:Loose"], "has no restoring force"),
        (["--plant", f"{__name__}:Scalar"], "write its equations with the `ops`"),
        (["--plant", "pendulum", "--dt", "1e-7"], "finer than 2.6e-05 s"),
        (["--plant", "pendulum", "--dt", "2.6"], "coarser than 2.6 s"),
        (["--plant", "pendulum", "--integrator", "planted:Missing"], "cannot load integrator"),
        (["--plant", "pendulum", "--integrator", "planted:NoPlant"], "is not an integrator"),
        (["--plant", "pendulum", "--integrator", "planted:Raising"], "KeyError: 'no such"),
        (["--integrator", "rk4", "planted:Wordy"], "`order` of the integrator 'planted:Wordy'"),
        (["--integrator", "planted:Unsure"], "`reversible` of the integrator 'planted:Unsure'"),
        (["--integrator", "planted:Pair"], "cannot take a step on acrobot"),
        (
            ["--plant", "pendulum", "--integrator", "rk4", "planted:Late"],
            "with planted:Late failed",
        ),
    ],
)
def test_bad_input_ends_with_one_line(arguments, message, tmp_path, capsys, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "tests" / "helpers" / "envs")
    quiet = [] if "--example" in arguments else ["--no-progress"]
    command = ["diagnose", *arguments, "--out", str(tmp_path / "out"), *quiet]
    assert main(command) == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert len(error.splitlines()) == 1
    left = [path.name for path in (tmp_path / "out").glob("*")]
    assert left == []


@pytest.fixture
def two_sections(monkeypatch):
    """Runs a diagnosis of two sections that are soon done."""
    monkeypatch.setattr(run, "SECTIONS", {n: run.SECTIONS[n] for n in ("integrator", "latency")})
    return lambda *words: main(["diagnose", *words, "--no-progress", "--workers", "1"])


def test_a_directory_is_taken_again(two_sections, tmp_path):
    for name in ("rk4", "explicit_euler"):
        words = ("--plant", "pendulum", "--integrator", name, "--out", str(tmp_path))
        assert two_sections(*words) == 0
        result = json.loads((tmp_path / "diagnose.json").read_text(encoding="utf-8"))
        assert result["integrators"] == [name]
    found = EvidenceStore(tmp_path / "evidence").query("SELECT DISTINCT integrator FROM records")
    assert set(found.column(0).to_pylist()) == {"explicit_euler", "reference"}
    page = (tmp_path / "diagnose.html").read_text(encoding="utf-8")
    assert not re.search(r"\brk4\b", re.sub(r"data:[^\"')]+", "", page))


def test_without_out_the_directory_is_of_the_commands_name(
    two_sections, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert two_sections("--integrator", "rk4", "--plant", "pendulun") == 2
    assert "pendulum" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert two_sections("--integrator", "rk4", "--plant", "pendulum") == 0
    page = tmp_path / "runs" / "diagnose" / "diagnose.html"
    assert str(page) in capsys.readouterr().out
    assert page.is_file()
    page.with_name("diagnose.json").unlink()
    assert two_sections("--integrator", "rk4", "--plant", "pendulum") == 2
    assert "holds evidence of something else than a diagnosis" in capsys.readouterr().err


def test_a_directory_that_goes_is_no_fault_of_the_plant(tmp_path, capsys, monkeypatch):
    def no_space(*arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Bench, "commit", no_space)
    monkeypatch.setattr(run, "SECTIONS", {"plant": identity.diagnose_plant})
    out = str(tmp_path / "out")
    assert main(["diagnose", "--plant", "pendulum", "--out", out, "--workers", "1"]) == 2
    assert f"cannot write to {out}: No space left on device" in capsys.readouterr().err


def test_theory_is_what_the_class_itself_declares():
    assert all(theory_of(name) is not None for name in INTEGRATORS.names())
    assert theory_of("planted:Boaster") is theory_of("no_such_module:Class") is None


@pytest.mark.parametrize("name", RESTING)
def test_rest_is_an_equilibrium(name):
    (subject,) = subjects(None, name, [])
    moved = advance("reference", subject.plant, subject.rest, 1.0)
    assert np.abs(moved - subject.rest).max() < 1e-8


@pytest.mark.parametrize("omega", [0.05, 1.0, 141.0, 1e4])
def test_stiff_and_slow_plants_come_to_rest(omega):
    for hardening in (0.0, 5.0):
        plant = Slider(stiffness=omega**2, hardening=hardening)
        assert np.abs(rest_state(plant)).max() < 1e-12
    pendulum = Pendulum(gravity=omega**2 * Pendulum().gravity / 15.0)
    np.testing.assert_allclose(rest_state(pendulum), (math.pi, 0.0), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("stiffness", [30.0, 1e8])
def test_a_stiff_spring_does_not_hide_a_slow_swing(stiffness):
    rest = rest_state(ElasticPendulum(stiffness=stiffness))
    np.testing.assert_allclose(rest, np.zeros(4), rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("plant", [Falling(), Hill(), Quadrotor()])
def test_what_never_rests_is_refused(plant):
    with pytest.raises(ValueError, match="does not come to rest without control"):
        rest_state(plant)


@pytest.mark.parametrize("name", RESTING)
def test_analytic_impact_is_what_the_plant_does(name):
    """Penetration and rebound of one impact, against the motion followed to rounding."""
    (subject,) = subjects(None, name, [])
    impact = impact_of(subject)
    if impact is None:
        assert not hasattr(subject.plant, "stopped")
        return
    plant = subject.varied(**impact.arguments)
    place = 2 * plant.stopped
    (start,) = sweep_approach(impact.touching, 1e-3, 0.1, 1)
    states = [start]
    for _ in range(600):
        states.append(advance("reference", plant, states[-1], 1e-3))
    path = np.array(states)
    deepest = path[:, place].max() - 2.0
    assert deepest == pytest.approx(impact.penetration(impact.stiffness), rel=1e-3)
    assert path[-1, place + 1] == pytest.approx(-math.sqrt(impact.rebound), rel=1e-8)


@pytest.mark.parametrize(
    ("given", "steps", "numbers"),
    [
        ((), (0.05, 0.02), ("−0.7968 %", "+3.585·10⁴ %", "−0.07413 %", "−3.435 %")),
        (("--dt", "0.1"), (0.1, 0.1), ("−2.324 %",)),  # of RK4, as its fifth power
    ],
)
def test_drift_example(given, steps, numbers, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(drift, "CART_POLE_TIMES", (10.0,))
    assert main(["diagnose", "--example", "drift", "--out", str(tmp_path), *given]) == 0
    printed = capsys.readouterr().out
    for text in (*numbers, *(f"dt {dt} s" for dt in steps)):
        assert text in printed
    assert (tmp_path / "drift.png").stat().st_size > 10_000


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
