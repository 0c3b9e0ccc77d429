"""Cells with other package versions: their records, what is verified of them, what is refused."""

import json
import os
import re
import shutil

import pytest
from interpreting import TINY, balance, fake_interpreter, push
from small_panel import bare_data

import integ_gym
from integ_gym.cli import main
from integ_gym.eval.panel.cells import SpecError, axes_between
from integ_gym.eval.panel.checking.setups import of_versions
from integ_gym.eval.panel.episodes import Subject, evaluate
from integ_gym.eval.panel.plan import read_planned_spec
from integ_gym.eval.panel.result import read_panel
from integ_gym.eval.panel.run_directory import read_manifest
from integ_gym.eval.panel.spec import parse_spec
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.interpreters import InterpreterError, interpreters_folder
from integ_gym.support.optional import package_version
from integ_gym.train.baselines import make_baseline

HOME = {"integrator": "explicit_euler", "dt": 0.02, "control_period": 0.02}


def _spec(**table):
    return parse_spec(bare_data({"integrator": "symplectic_euler", "dt": 0.05}, table), "test")


@pytest.mark.parametrize(
    ("value", "lists"),
    [
        ("tiny==1.0", [("tiny==1.0",)]),
        (["tiny==1.0", "small==2"], [("tiny==1.0", "small==2")]),
        ([["tiny==1.0"], ["tiny==2.0", "small==2"]], [("tiny==1.0",), ("tiny==2.0", "small==2")]),
    ],
)
def test_a_list_of_packages_is_one_value(value, lists):
    spec = _spec(at="home", packages=value)
    cells = [cell for cell in spec.cells_of(spec.train[0]) if cell.packages]
    assert [cell.packages for cell in cells] == lists
    assert [cell.name.partition(", ")[2] for cell in cells] == [" ".join(own) for own in lists]
    for cell in cells:
        assert set(axes_between(spec.train[0], cell)) == {"version"}
        assert "packages" not in cell.arguments({})
    again = read_planned_spec(json.loads(json.dumps(spec.to_json())))
    assert again.cells_of(again.train[0]) == spec.cells_of(spec.train[0])


def test_what_is_no_version_is_refused():
    with pytest.raises(SpecError, match="exact versions"):
        _spec(at="home", packages="tiny")


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A user's cache with an interpreter that has a tiny package."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("XDG_CACHE_HOME", str(folder))
        fake_interpreter(folder)
        yield folder


def _evaluate(out, **changed):
    given = {
        "home": HOME, "integrators": ["rk4"], "dts": [0.02], "episodes": 4,
        "workers": 1, "progress": False, "environment": {"duration": 1.0},
        "varied": {"packages": [*TINY], "action_latency": [0.0, 0.2]},
    }  # fmt: skip
    return integ_gym.evaluate(push, "IntegCartPole-v0", out, **{**given, **changed})


@pytest.fixture(scope="module")
def judged(cache, tmp_path_factory):
    """A finished run with such cells."""
    out = tmp_path_factory.mktemp("judged") / "out"
    _evaluate(out)
    return out


_COMPARED = """
SELECT a.cell, a.success, a.failure_label, b.failure_label AS twin, b.success AS same,
       a."return" = b."return" AND a.theta IS NOT DISTINCT FROM b.theta AS equal,
       a.package_versions AS versions
FROM records a JOIN records b ON b.policy_id = a.policy_id AND b.phase = a.phase
AND b.episode_index = a.episode_index AND b.cell = replace(a.cell, ', tiny==1.0', '')
WHERE a.cell LIKE '%tiny==1.0%'
"""


def test_episodes_there_are_those_of_here_and_labelled_alike(judged):
    store = EvidenceStore(judged / "evidence")
    rows = store.query(_COMPARED).to_pylist()
    assert {row["cell"] for row in rows} >= {
        "explicit_euler dt=0.02, tiny==1.0", "rk4 dt=0.02, tiny==1.0",
        "reference dt=0.02, tiny==1.0",
    }  # fmt: skip
    assert all(row["equal"] for row in rows)
    assert all(json.loads(row["versions"])["tiny"] == "1.0" for row in rows)
    assert {row["failure_label"] for row in rows if row["success"]} == {"none"}
    plain = store.query("SELECT package_versions AS v FROM records WHERE perturbation IS NULL")
    assert not any("tiny" in text for text in plain.column("v").to_pylist())


def test_labels_there_rest_on_what_was_played_here(judged):
    rows = EvidenceStore(judged / "evidence").query(
        "SELECT cell, replay_home, home_success FROM records WHERE policy_id = 'push' "
        "AND phase = 'evaluation' AND cell LIKE '%tiny==1.0%'"
    ).to_pylist()  # fmt: skip
    assert {row["home_success"] for row in rows} == {1.0}
    elsewhere = [row for row in rows if row["cell"].startswith("rk4")]
    assert None not in {row["replay_home"] for row in elsewhere}


def test_what_versions_cost_is_told_apart(judged):
    panel = read_panel(judged / "panel.json")
    found = [one for one in panel.separations if "version" in [axis.axis for axis in one.axes]]
    assert found
    for one in found:
        (version,) = (axis for axis in one.axes if axis.axis == "version")
        assert version.lost_alone.estimate == 0.0


def test_a_policy_without_such_cells_is_evaluated_beside_one_that_has_them(cache, tmp_path):
    spec = _spec(at="home", packages=[*TINY])
    (home,) = spec.train
    idle, random = (make_baseline(name, spec.nominal) for name in ("zero", "random"))
    subjects = [Subject(idle, spec.cells_of(None)), Subject(random, spec.cells_of(home), home)]
    tables = list(evaluate(spec, subjects, range(1), EvidenceStore(tmp_path), {}))
    found = [record for table in tables for record in table.to_pylist()]
    assert {r["policy_id"] for r in found if "tiny" in r["cell"]} == {"random"}


def _verify(run, capsys, *further):
    code = main(["evidence", "verify", str(run), "--all", "--no-progress", *further])
    return code, capsys.readouterr().out


@pytest.mark.slow
def test_verify_plays_them_again_in_their_interpreter(judged, capsys, monkeypatch, tmp_path):
    code, told = _verify(judged, capsys, "--exact")
    traced = EvidenceStore(judged / "evidence").query("SELECT reward FROM records")
    count = len(traced) - traced.column("reward").null_count
    assert code == 0, told
    (found,) = re.findall(r"replayed: (\d+) of \d+ records, (\d+) of them to the last bit", told)
    assert int(found[0]) == int(found[1]) >= count
    assert "interpreter" not in told
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    code, told = _verify(judged, capsys)
    assert code == 0, told
    assert "records of tiny==1.0, with which there is no interpreter here" in told
    assert "--make-interpreters" in told


def test_other_versions_than_were_planned_are_found(judged):
    versions = read_manifest(judged / "run.json")["versions"]
    store = EvidenceStore(judged / "evidence")
    assert not list(of_versions(versions, store))
    assert list(of_versions({**versions, "numpy": "1.0"}, store))


@pytest.mark.slow
def test_several_workers_come_to_the_same(judged, cache, tmp_path):
    _evaluate(tmp_path / "out", workers=2)
    columns = "record_id, content_hash"
    sql = f"SELECT {columns} FROM records ORDER BY record_id"
    one, other = (EvidenceStore(run / "evidence").query(sql) for run in (judged, tmp_path / "out"))
    assert one.equals(other)


@pytest.mark.slow
def test_versions_that_are_here_need_no_interpreter(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    here = f"numpy=={package_version('numpy')}"
    _evaluate(tmp_path / "out", varied={"packages": [here]}, episodes=2, dts=[0.02])
    assert not interpreters_folder().exists()
    cells = EvidenceStore(tmp_path / "out" / "evidence").query("SELECT DISTINCT cell FROM records")
    assert f"explicit_euler dt=0.02, {here}" in cells.column("cell").to_pylist()


def test_nothing_is_begun_where_no_interpreter_can_be_made(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("UV_OFFLINE", "1")
    with pytest.raises(InterpreterError, match="uv says"):
        _evaluate(tmp_path / "out", varied={"packages": ["no-such-package-of-ours==1.0"]})
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_another_mujoco_judges_in_an_interpreter_that_uv_makes(tmp_path, monkeypatch):
    downloads = os.environ.get("XDG_CACHE_HOME", os.path.expanduser("~/.cache"))
    monkeypatch.setenv("UV_CACHE_DIR", os.environ.get("UV_CACHE_DIR", f"{downloads}/uv"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    found = []
    for name in ("first", "offline"):
        out = tmp_path / name
        integ_gym.evaluate(
            balance, "InvertedPendulum-v5", out, home="stock", integrators=["RK4"], dts=[0.02],
            episodes=2, workers=1, progress=False, at=["home"],
            varied={"packages": ["mujoco==3.1.0"]},
        )  # fmt: skip
        rows = EvidenceStore(out / "evidence").query(
            "SELECT record_id, cell, engine_version, package_versions, content_hash FROM records "
            "ORDER BY record_id"
        ).to_pylist()  # fmt: skip
        there = [row for row in rows if "mujoco==3.1.0" in row["cell"]]
        assert {row["engine_version"] for row in there} == {"3.1.0"}
        assert {json.loads(row["package_versions"])["mujoco"] for row in there} == {"3.1.0"}
        assert {row["engine_version"] for row in rows if row not in there} != {"3.1.0"}
        found.append(rows)
        monkeypatch.setenv("UV_OFFLINE", "1")
    assert found[0] == found[1]
    shutil.rmtree(interpreters_folder())
    command = ["evidence", "verify", str(out), "--all", "--exact", "--no-progress"]
    assert main([*command, "--make-interpreters"]) == 0
    assert list(interpreters_folder().glob("*/interpreter.json"))
