"""Films of recorded episodes: traces as they were recorded, twins played again."""

from __future__ import annotations

import json
import shutil
from functools import partial

import numpy as np
import pytest

from integ_gym.cli import main
from integ_gym.envs import DISCRETIZATION, Discretization
from integ_gym.eval.film import of_record, watch
from integ_gym.eval.panel.existing.run_policies import policy_of
from integ_gym.evidence import open_run


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


TRAINED = "policy_id LIKE '%rk4%' AND cell = 'explicit_euler dt=0.05'"


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


@pytest.mark.parametrize("policy", ["%rk4%", "handmade", "random", "zero"])
@pytest.mark.parametrize("perturbation", ["IS NULL", "LIKE '%mass%'", "LIKE '%latency%'"])
def test_what_is_played_again_is_what_was_recorded(panel_directory, policy, perturbation):
    """Trained policies to the last bits of their actions, baselines exactly."""
    record = record_where(
        panel_directory,
        f"policy_id LIKE '{policy}' AND integrator = 'reference' AND energy IS NOT NULL "
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


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["RUN", "zz"], "no record 'zz'"),
        (["RUN"], "is no trained policy; give the id of one of its records"),
        (["absent"], "there is no absent"),
        (["RUN", "a", "--seed", "1"], "is for a trained policy"),
        (["RUN", "a", "--out", "film.avi"], "written as .gif or .mp4"),
    ],
)
def test_bad_input_ends_with_one_line(panel_directory, words, message, capsys):
    given = [str(panel_directory) if word == "RUN" else word for word in words]
    assert main(["watch", *given]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
