"""Films of recorded episodes: traces as they were recorded, twins played again."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from integ_gym.cli import main
from integ_gym.envs.settings import DISCRETIZATION, Discretization
from integ_gym.eval import watch as of_record
from integ_gym.eval.panel.policies import policy_of
from integ_gym.eval.watch import watch
from integ_gym.evidence.store import open_run


def record_where(run, condition: str):
    store = open_run(run)
    sql = f"SELECT record_id FROM records WHERE {condition} ORDER BY record_id LIMIT 1"
    (found,) = store.query(sql).column("record_id").to_pylist()
    return store.find(found)


def played_again(record, success, run, on_doubt):
    """The episode of a record as if it had no trace."""
    cell = Discretization(**{name: record[name] for name in DISCRETIZATION})
    policy = partial(policy_of, record, open_run(run))
    return of_record._episode(cell, record, success, policy, on_doubt)


EVALUATED = "phase = 'evaluation'"
TRAINED = f"{EVALUATED} AND policy_id LIKE '%rk4%' AND cell = 'explicit_euler dt=0.05'"


def test_a_record_with_a_trace_is_shown_as_it_was_recorded(panel_directory):
    record = record_where(panel_directory, f"{TRAINED} AND energy IS NOT NULL")
    film = watch(panel_directory, record["record_id"][:12])
    home, own, truth = film.episodes
    assert home.discretization.name == "rk4 dt=0.05"
    assert truth.discretization.integrator == "reference"
    np.testing.assert_array_equal(own.states[:, 0], record["theta"])
    assert own.success == record["success"]
    *parts, energy = own.ledger().values()
    np.testing.assert_allclose(sum(parts), energy, atol=1e-9)
    for episode in film.episodes:
        np.testing.assert_array_equal(episode.states[0], record["initial_state"])
        assert episode.times[-1] == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("policy", "perturbation"),
    [
        ("%rk4%", "IS NULL"),
        ("%rk4%", "LIKE '%latency%'"),
        ("handmade", "LIKE '%mass%'"),
        ("random", "LIKE '%latency%'"),
        ("zero", "IS NULL"),
    ],
)
def test_what_is_played_again_is_what_was_recorded(panel_directory, policy, perturbation):
    """Trained policies to the last bits of their actions, baselines exactly."""
    record = record_where(
        panel_directory,
        f"{EVALUATED} AND policy_id LIKE '{policy}' AND integrator = 'reference' "
        "AND energy IS NOT NULL "
        f"AND perturbation {perturbation}",
    )
    again = played_again(record, record["success"], panel_directory, pytest.fail)
    np.testing.assert_allclose(again.states[:, 0], record["theta"], atol=1e-4)
    np.testing.assert_array_equal(again.states[0], record["initial_state"])


def test_a_run_without_its_policy_shows_traces_alone(panel_directory, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(panel_directory, run)
    shutil.rmtree(run / "policies")
    record = record_where(run, f"{TRAINED} AND energy IS NOT NULL")
    film = watch(run, record["record_id"], ["explicit_euler", "rk4"])
    assert len(film.episodes) == 2
    film = watch(run, record["record_id"], on_doubt=pytest.fail)  # all of it has traces
    assert len(film.episodes) == 3
    with pytest.raises(ValueError, match=r"is not in .*policies and cannot be made again"):
        watch(run, record["record_id"], ["implicit_midpoint"])


def test_another_ending_than_recorded_is_told(panel_directory):
    record = record_where(panel_directory, TRAINED)
    doubts: list[str] = []
    played_again(record, not record["success"], panel_directory, doubts.append)
    (doubt,) = doubts
    assert "explicit_euler dt=0.05" in doubt


def test_the_command_writes_a_film_of_a_record(panel_directory, tmp_path, capsys):
    record = record_where(panel_directory, TRAINED)
    out = tmp_path / "film.gif"
    words = ["watch", str(panel_directory), record["record_id"], "--on", "explicit_euler", "truth"]
    assert main([*words, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "explicit_euler dt=0.05\n" in printed
    assert f"Film: {out}" in printed
    assert out.read_bytes()[:6] == b"GIF89a"


def test_the_command_shows_a_trained_policy(panel_directory, tmp_path, capsys):
    policy = next((panel_directory / "policies").glob("rk4*"))
    out = tmp_path / "film.mp4"
    assert main(["watch", str(policy), "--seed", "5", "--out", str(out)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(maxsplit=1)[1] for line in lines[:2]] == ["rk4 dt=0.05", "truth dt=0.05"]
    assert out.stat().st_size > 1000
    assert json.loads((policy / "policy.json").read_text())["seed"] in (0, 1)


LEVELS = "policy_id = 'levels' AND env_id = 'IntegPendulum-v0'"


def test_code_that_a_record_names_is_not_run_unasked(diagnosis):
    run, *_ = diagnosis
    record = record_where(run, f"{LEVELS} AND integrator = 'planted:Silent'")
    with pytest.raises(ValueError, match=r"names 'planted:Silent'.*pass --own-code"):
        watch(run, record["record_id"])
    of_theirs = replace(record, fields={**record.fields, "env_id": "their_module:Task-v0"})
    with pytest.raises(ValueError, match=r"names 'their_module:Task-v0'.*pass --own-code"):
        of_record._check_code(of_theirs, own_code=False)


def test_a_run_without_a_record_lists_a_few_that_are_worth_a_film(panel_directory, capsys):
    assert main(["watch", str(panel_directory)]) == 0
    printed = capsys.readouterr().out
    listed = re.findall(r"^([0-9a-f]{8})  (.+?)  ", printed, re.MULTILINE)
    assert 0 < len(listed) <= 10
    store = open_run(panel_directory)
    for prefix, cell in listed[:2]:
        record = store.find(prefix)
        assert (record["cell"], record["success"]) == (cell, False)
    labels = re.findall(r"(\w+_error|not_learned|unattributed|unachievable|too_slow) ", printed)
    caused = [label == "discretization_error" for label in labels]
    assert caused == sorted(caused, reverse=True)


TRACED = f"{TRAINED} AND energy IS NOT NULL"
BARE_TRAINING = "phase = 'training' AND energy IS NULL"
REFUSALS = [
    ("untraced training", BARE_TRAINING, [], "or one that has a trace, without --on"),
    (
        "training elsewhere", "phase = 'training' AND energy IS NOT NULL", ["--on", "rk4"],
        "policy of a training episode has changed since",
    ),
    ("no integrator", TRACED, ["--on", "no_such"], "unknown integrator 'no_such'. Valid choices"),
    (
        "not of that engine", TRACED, ["--on", "mujoco rk4"],
        "'mujoco' has no integrator 'rk4'; what applies it is 'RK4'",
    ),
    ("no step", TRACED, ["--on", "rk4 dt=0"], "must be a finite number above 0"),
    (
        "a step that does not divide", TRACED, ["--on", "rk4 dt=0.03"],
        r"`dt`=0.03 s does not divide .* nearest valid: 0.025 or 0.05 s",
    ),
    ("too long a step", TRACED, ["--on", "rk4 dt=inf"], "nearest valid: 0.05 s"),
    ("no film's ending", TRACED, ["--out", "film.avi"], "written as .gif or .mp4, got 'film.avi'"),
    ("no folder", TRACED, ["--out", "absent/film.gif"], "there is no folder absent; make it"),
    ("a folder", TRACED, ["--out", "FOLDER.gif"], "is a folder; give another path for the film"),
]  # fmt: skip


@pytest.mark.parametrize(("record", "words", "message"), [own[1:] for own in REFUSALS],
                         ids=[own[0] for own in REFUSALS])  # fmt: skip
def test_a_record_is_refused_in_one_line(
    record, words, message, panel_directory, tmp_path, capsys, monkeypatch
):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(
        of_record.film, "play_episode", lambda *a, **k: pytest.fail("an episode was run")
    )
    if " = " in record or " LIKE " in record:
        record = record_where(panel_directory, record)["record_id"]
    (tmp_path / "folder.gif").mkdir()
    words = [word.replace("FOLDER", str(tmp_path / "folder")) for word in words]
    assert main(["watch", str(panel_directory), record, *words]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error)
    assert error.count("\n") == 1
