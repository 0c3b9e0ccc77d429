"""A panel that is given more seeds, and one that is shown before it is finished."""

import json
import re
import shutil
import tomllib
from pathlib import Path

import pytest
from engine_cases import needs
from small_panel import ALONE, TINY

import integ_gym
from integ_gym.cli import main
from integ_gym.eval.panel import outputs
from integ_gym.eval.panel import plan as growth
from integ_gym.eval.panel import run as calls
from integ_gym.eval.panel.result import read_panel
from integ_gym.eval.panel.spec import parse_spec
from integ_gym.evidence.store import EvidenceStore

SAME = ("row", "cell", "success_by_seed", "return", "energy_residual", "overfitting", "labels")


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY, encoding="utf-8")
    return path


def _hashes(directory: Path) -> list[dict]:
    query = "SELECT record_id, content_hash FROM records WHERE phase = 'evaluation' ORDER BY 1"
    return EvidenceStore(directory / "evidence").query(query).to_pylist()


def _matrix(panel: dict) -> list[list]:
    return [[entry[name] for name in SAME] for entry in panel["matrix"]]


LATER = TINY[TINY.rindex("[[perturbations]]") :]
LATE = '[[perturbations]]\nname = "late"\nenvironment = { action_latency = 0.05 }\n'
"""Another perturbation in the place of the only one."""


@pytest.mark.slow
def test_a_panel_given_an_engine_keeps_what_it_has(spec, tmp_path, tiny_panel, capsys):
    """What is there does not depend on that engine's version, which is noted."""
    needs("mujoco")
    copy = tmp_path / "copy"
    shutil.copytree(tiny_panel, copy)
    files = {p: p.read_bytes() for p in copy.glob("[uep]*/**/*") if p.is_file()}
    engine = 'engine = "mujoco"\nintegrator = "RK4"\ndt = 0.05\n'
    spec.write_text(f"{TINY}\n[[evaluate]]\n{engine}", encoding="utf-8")
    assert main(["panel", str(spec), "--out", str(copy), *ALONE]) == 0
    assert "cell 'mujoco RK4 dt=0.05'. All else is kept." in capsys.readouterr().err
    assert files == {path: path.read_bytes() for path in files}
    assert {record["record_id"] for record in _hashes(tiny_panel)} < {
        record["record_id"] for record in _hashes(copy)
    }
    assert "mujoco" in json.loads((copy / "run.json").read_text())["versions"]
    assert main(["evidence", "verify", str(copy)]) == 0


@pytest.mark.slow
def test_a_panel_given_episodes_seeds_and_a_perturbation_is_the_panel_that_had_them_in_those_parts(
    spec, tmp_path, tiny_panel, capsys
):
    """Nothing is trained or evaluated twice, and the records are the same."""
    copy, once = tmp_path / "copy", tmp_path / "once"
    shutil.copytree(tiny_panel, copy)
    files = {p: p.stat().st_mtime_ns for p in copy.glob("[uep]*/**/*") if p.is_file()}
    before = {row["record_id"]: row["content_hash"] for row in _hashes(copy)}
    stiffer = '[[perturbations]]\nname = "damped"\nenvironment = { damping = 0.1 }\n'
    larger = TINY.replace("seeds = [0, 1]", "seeds = [0, 1, 2]") + stiffer
    asked = larger.replace("episodes = 3", "episodes = 5")
    spec.write_text(f'question = "And with damping?"\n{asked}', encoding="utf-8")
    command = ["panel", str(spec), *ALONE, "--out"]
    assert main([*command, str(copy)]) == 0
    told = capsys.readouterr().err
    assert f"New in {copy}: variation 'damped' (damping=0.1); " in told
    for words in ("seeds 2", "2 more episodes a seed", "question", "All else is kept."):
        assert words in told
    assert files == {path: path.stat().st_mtime_ns for path in files}
    assert before.items() <= {r["record_id"]: r["content_hash"] for r in _hashes(copy)}.items()
    assert main(["evidence", "verify", str(copy)]) == 0
    panel = json.loads((copy / "panel.json").read_text())
    assert {entry["episodes"] for entry in panel["matrix"] if entry["row"] == "random"} == {5}
    assert panel["question"] == "And with damping?"
    assert [look["seeds"] for look in panel["looks"]] == [2, 3]
    assert (panel["spec"]["episodes"], panel["spec"]["episode_parts"]) == (5, [3, 2])
    (seen,) = read_panel(copy / "panel.json").warnings
    assert "the last on 2 seeds of 3 starts" in seen
    assert main([*command, str(copy)]) == 0, "the same again"
    assert "New in" not in capsys.readouterr().err
    assert json.loads((copy / "panel.json").read_text()) == panel
    spec.write_text(larger.replace("episodes = 3", "episodes = [3, 2]"), encoding="utf-8")
    assert main([*command, str(once), "--policies", str(copy)]) == 0
    assert _hashes(once) == _hashes(copy)
    whole = json.loads((once / "panel.json").read_text())
    assert _matrix(whole) == _matrix(panel)
    assert whole["doubts"] == []


def leaning(observation):
    """Push where the pole leans: it holds for a moment, from some starts."""
    return int(observation[2] > 0)


_BY_PART = """
SELECT episode_index >= 6 AS later, count(DISTINCT episode_index) AS episodes,
       count(*) FILTER (success AND cell = 'explicit_euler dt=0.02') AS succeeded,
       min(home_success) AS low, max(home_success) AS high,
       count(*) FILTER (failure_label = 'not_learned') > 0 AS not_learned
FROM records WHERE policy_id = 'leaning' AND phase = 'evaluation' GROUP BY ALL ORDER BY later
"""


@pytest.mark.slow
def test_labels_of_later_episodes_rest_on_success_at_home_in_all(tmp_path):
    for episodes in (6, 10):
        panel = integ_gym.evaluate(
            leaning, "IntegCartPole-v0", tmp_path / "out", episodes=episodes, progress=False,
            home={"integrator": "explicit_euler", "dt": 0.02, "control_period": 0.02},
            integrators=["explicit_euler"], dts=[0.02], environment={"duration": 0.8},
        )  # fmt: skip
    first, later = EvidenceStore(tmp_path / "out" / "evidence").query(_BY_PART).to_pylist()
    assert (first["episodes"], later["episodes"]) == (6, 4)
    assert first["low"] == first["high"] == first["succeeded"] / 6 < 0.5
    assert later["low"] == later["high"] == (first["succeeded"] + later["succeeded"]) / 10 >= 0.5
    assert (first["not_learned"], later["not_learned"]) == (True, False)
    (row,) = (row for row in panel.rows if row.kind == "given")
    assert row.home_success.estimate == later["high"]
    assert main(["evidence", "verify", str(tmp_path / "out")]) == 0


@pytest.mark.parametrize(
    ("was", "now", "sentence"),
    [
        (LATER, LATE, "it has variation 'mass .*, which is missing now; .* started with$"),
        ("mass = 1.2", "mass = 1.3", r"variation '.*' \(mass=1.2\), which is missing now;"),
        ('family = [["explicit_euler dt=0.05", "reference dt=0.05"]]', "", "`family`"),
        ("seeds = [0, 1]", "seeds = [0, 5]", "other seeds: 0 to 1, now 0 to 5; more may follow"),
        ("seeds = [0, 1]", "seeds = [1, 0, 2]", "other seeds: 0 to 1, now 1 to 2; more may"),
        ("seeds = [0, 1]", "seeds = [0]", "this panel with 2 seeds, not 1; give --seeds 2, or"),
        (
            "episodes = 3",
            "episodes = 2",
            r"`episodes` 3 \(now 2\); .* \(--policies .* takes the policies",
        ),
        ("episodes = 3", "episodes = [2, 2]", r"`episodes` 3 \(now 2 \+ 2\); .* --out \(--pol"),
        ("max_torque = 1.0", "max_torque = 1.1", "`environment.max_torque` 1.0"),
        ('trainer = "sb3"', 'trainer = "fleet"', "`trainer"),
    ],
)
def test_what_contradicts_is_refused(spec, run, capsys, was, now, sentence):
    assert was in TINY
    spec.write_text(TINY.replace(was, now), encoding="utf-8")
    before = {file: file.stat().st_mtime_ns for file in run.rglob("*")}
    assert main(["panel", str(spec), "--out", str(run)]) == 2
    assert re.search(f"holds (another panel: .*|a panel with |){sentence}", capsys.readouterr().err)
    assert {file: file.stat().st_mtime_ns for file in run.rglob("*")} == before


@pytest.mark.slow
def test_a_page_that_comes_early_decides_nothing(tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr(growth, "STAGES", (1,))
    monkeypatch.setattr(outputs, "write_outputs", _spied(outputs.write_outputs, shown))
    spec = parse_spec({**tomllib.loads(TINY), "seeds": [0, 1, 2]}, "tiny")
    calls.run_panel(spec, tmp_path / "out", workers=1, progress=False)
    first, last = shown
    assert first.answer.startswith("Not decided yet: 1 of 3 training seeds are here")
    assert first.looks == ()
    assert {row.seeds for row in first.rows if not row.baseline} == {1}
    assert all(one.p_exceeds is None for one in first.verdicts)
    assert "Not decided yet" not in last.answer
    assert [look.seeds for look in last.looks] == [3]


def _spied(function, shown):
    def call(*given, **told):
        panel = function(*given, **told)
        shown.append(panel)
        return panel

    return call


def test_an_evaluation_into_a_panel_is_refused_with_what_evaluate_takes(
    tmp_path, tiny_panel, capsys
):
    policy = next((tiny_panel / "policies").glob("*/policy.safetensors"))
    command = ["evaluate", str(policy), "--env", "IntegPendulum-v0", "--out", str(tiny_panel)]
    assert main([*command, "--integrator", "rk4", "--dt", "0.05"]) == 2
    error = capsys.readouterr().err
    assert "give another directory with --out" in error
    assert "--seeds" not in error
