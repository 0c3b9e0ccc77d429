"""A run's directory that is damaged is refused by name, and holds no remains."""

from __future__ import annotations

import os
import socket
import time
from dataclasses import replace

import pytest
from shared_panel import specification

from integ_gym.cli import main
from integ_gym.eval.panel.costs import fixed_cost, policy_costs, total_cost
from integ_gym.eval.panel.plan import with_seed_count
from integ_gym.eval.panel.run_directory import (
    MANIFEST,
    PACKAGES,
    RunDirectory,
    RunDirectoryError,
    Seen,
)
from integ_gym.eval.panel.spec import TRAINERS, read_spec
from integ_gym.eval.panel.training import waiting_chunks
from integ_gym.eval.panel.units import trained_units
from integ_gym.support.files import read_files
from integ_gym.train.fleet.worker import Workers


@pytest.fixture
def directory(tmp_path):
    made = RunDirectory(tmp_path / "run", {"name": "a"})
    with made.opened():
        made.finish("train-a", "key", time.time(), policy="hash", records="hash")
    return made


def test_what_an_interrupted_run_left_is_gone_when_it_goes_on(directory):
    folder = directory.policies / "a"
    figures = directory.path / "figures"
    folder.mkdir()
    figures.mkdir()
    places = (directory.path, directory.evidence, directory.path / "units", figures, folder)
    for place in places:
        (place / ".left.0123.tmp").write_text("half")
    with directory.opened():
        assert not [file for place in places for file in place.glob(".*.tmp")]
    assert not (directory.path / ".lock").exists()


@pytest.mark.parametrize("trainer", TRAINERS)
def test_a_run_depends_on_what_its_trainer_does_and_not_on_what_else_is_installed(
    trainer, tmp_path
):
    """All trainers are installed here; a fleet's run is gone on with where they come later."""
    spec = replace(read_spec("quick"), trainer=trainer)
    versions = RunDirectory(tmp_path / "run", spec.to_json()).versions()
    assert versions.keys() == {"python", *PACKAGES, *TRAINERS[trainer]}
    assert set(TRAINERS["sb3"]).isdisjoint(PACKAGES)


def test_packages_of_a_run_are_those_that_it_began_with(tmp_path):
    with RunDirectory(tmp_path / "run", {"name": "a"}).opened():
        pass
    before = (tmp_path / "run" / MANIFEST).read_bytes()
    with RunDirectory(tmp_path / "run", {"name": "a"}, {"mujoco": "1"}).opened():
        pass
    assert (tmp_path / "run" / MANIFEST).read_bytes() == before


def test_time_that_another_run_spent_is_not_this_ones(tmp_path):
    made, other = (RunDirectory(tmp_path / name, {"name": name}) for name in ("run", "other"))
    with made.opened():
        made.finish("train-a", "key", time.time() - 100.0, policy="hash")
    with other.opened():
        other.adopt(made, "train-a")
        other.finish("train-b", "key", time.time() - 10.0, policy="hash")
    units = ["train-a", "train-b"]
    assert made.seconds(units) == pytest.approx(100.0, abs=1.0)
    assert other.seconds(units) == pytest.approx(10.0, abs=1.0)
    assert other.wall_seconds(units) == pytest.approx(10.0, abs=1.0)


def test_a_training_in_which_no_episode_ended_has_no_records(tmp_path):
    """As where the time limit is longer than the training: finished, and whole."""
    made, other = (RunDirectory(tmp_path / name, {"name": name}) for name in ("run", "other"))
    with made.opened():
        made.finish("train-a", "key", time.time(), policy="hash")
    assert made.marker("train-a")["records"] is None
    assert made.finished("train-a", "key") is not None
    assert list(made.faults()) == []
    with other.opened():
        other.adopt(made, "train-a")
    assert other.finished("train-a", "key") is not None
    (made.evidence / "train-a.parquet").write_bytes(b"PAR1 of somebody PAR1")
    with pytest.raises(RunDirectoryError, match="was changed after unit train-a was finished"):
        made.finished("train-a", "key")
    assert [found.file for found in made.faults()] == ["evidence/train-a.parquet"]


def test_another_driver_is_told_who_works_there_and_since_when(directory):
    with directory.opened():
        other = RunDirectory(directory.path, {"name": "a"})
        holder = rf"process {os.getpid()} on {socket.gethostname()} \(since 20.* UTC\) is running"
        with pytest.raises(RunDirectoryError, match=holder):
            other.opened().__enter__()
        assert (directory.path / ".lock").exists()
    with directory.opened():
        pass


def test_what_was_done_elsewhere_is_put_in_place_with_its_marker_last(directory, tmp_path):
    """Whoever is killed in between leaves a unit that is not finished."""
    there = directory.copy_for_workers().moved(tmp_path / "scratch")
    (there.evidence / "achieve-a.parquet").write_text("records")
    there.finish(
        "achieve-a", "key", time.time(), cell="a", success=[], recovered=[], search=None, first=0
    )
    files = read_files(there.path)
    assert [*files] == ["evidence/achieve-a.parquet", "units/achieve-a.json"]
    directory.take(dict(reversed(files.items())))
    written = [directory.path / name for name in files]
    assert written[0].stat().st_mtime_ns < written[1].stat().st_mtime_ns
    assert directory.finished("achieve-a", "key") is not None


def test_looks_at_verdicts_are_noted_of_what_is_done_elsewhere(directory, tmp_path):
    with directory.opened():
        directory.record_look(Seen(2, 3, 0))
        there = directory.copy_for_workers().moved(tmp_path / "scratch")
        there.finish("train-b", "key", time.time(), policy="hash")
        directory.take(read_files(there.path))
        assert list(directory.lost_looks()) == []
        directory.note(looks=[])
        assert list(directory.lost_looks()) == ["train-b"]


@pytest.mark.slow
def test_storage_is_that_of_a_run(undisturbed, tmp_path):
    """Within a third: a run as small as this is all but its files' heads."""
    spec = read_spec(specification(tmp_path))
    told = total_cost([*policy_costs(spec), fixed_cost(spec)]).storage
    folders = ("evidence", "policies")
    held = sum(f.stat().st_size for name in folders for f in (undisturbed / name).rglob("*.*"))
    assert 0.67 < told / held < 1.5


def test_the_command_tells_it_and_runs_nothing(tmp_path, capsys):
    words = ["panel", str(specification(tmp_path)), "--plan", "--workers", "8"]
    before = sorted(tmp_path.iterdir())
    assert main(words) == 0
    told = capsys.readouterr().out
    assert sorted(tmp_path.iterdir()) == before
    assert "4 policies and 1 baseline" in " ".join(told.split())
    for count in ("4 (this panel)", "10 ", "1,000", "100,000"):
        assert any(line.startswith(count) for line in told.splitlines()), count
    assert "on 8 workers" in told
    assert main([*words, "--policies", str(tmp_path)]) == 0
    trained, judged = (_hours(text) for text in (told, capsys.readouterr().out))
    assert trained[0] > judged[0] == 0.0
    assert trained[1] == judged[1] == judged[2]
    assert 3600.0 * min(trained[:2]) > 8.0  # compilation and the page, however little is computed


def _hours(told: str) -> list[float]:
    """Core hours of training, of evaluation and together, of the panel itself."""
    (line,) = (line for line in told.splitlines() if "(this panel)" in line)
    return [float(cell) for cell in line.partition("(this panel)")[2].split()[:3]]


TWO, MANY = Workers(2, "cpu"), Workers(64, "cpu")


def _names(chunks):
    return [[unit.policy for unit in chunk] for chunk in chunks]


def test_who_is_trained_together_stays_whoever_goes_on(tmp_path):
    """Growing adds to it; another number of workers changes nothing."""
    spec = read_spec(specification(tmp_path))
    directory = RunDirectory(tmp_path / "run", spec.to_json())
    with directory.opened():
        first = _names(waiting_chunks(spec, directory, TWO, 3.0))
        assert _names(waiting_chunks(spec, directory, MANY, 96.0)) == first
        more = with_seed_count(spec, 4)
        assert _names(waiting_chunks(more, directory, MANY, 96.0))[: len(first)] == first
        assert sorted(p for chunk in first for p in chunk) == sorted(
            unit.policy for unit in trained_units(spec)
        )
        directory.finish_work()
        assert _names(waiting_chunks(spec, directory, MANY, 96.0)) != first
