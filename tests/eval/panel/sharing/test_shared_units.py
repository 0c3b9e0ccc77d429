"""A unit is a small value, and what it leaves is put in place whole, once it is decided."""

from __future__ import annotations

import json
import pickle
import time

import pytest
from shared_panel import specification

from integ_gym.eval.panel.running.division import waiting_chunks
from integ_gym.eval.panel.running.run_directory import RunDirectory
from integ_gym.eval.panel.running.staging import DRIVEN, Desk, clear, retire
from integ_gym.eval.panel.running.units import trained_units
from integ_gym.eval.panel.sharing.planning import training
from integ_gym.eval.panel.sharing.shared_unit import SharedUnit
from integ_gym.eval.panel.specification.growth import grown
from integ_gym.eval.panel.specification.reading import read_spec
from integ_gym.support.sharing.claims import Claims
from integ_gym.support.sharing.folder_files import FolderFiles
from integ_gym.train.fleet.worker import Workers

TWO, MANY = Workers(2, "cpu"), Workers(64, "cpu")


@pytest.fixture
def spec(tmp_path):
    return read_spec(specification(tmp_path))


@pytest.fixture
def directory(tmp_path, spec):
    return RunDirectory(tmp_path / "run", spec.to_json())


def test_a_unit_is_small_and_survives_json(spec, directory):
    with directory.opened():
        units = training(spec, directory, TWO, 3.0)
    assert len(units) == 2
    for unit in units:
        assert len(pickle.dumps(unit)) < 1000
        assert SharedUnit.of(json.loads(json.dumps(unit.plain()))) == unit


def _names(chunks):
    return [[unit.policy for unit in chunk] for chunk in chunks]


def test_who_is_trained_together_stays_whoever_goes_on(spec, directory):
    """Growing adds to it; another number of workers changes nothing."""
    with directory.opened():
        first = _names(waiting_chunks(spec, directory, TWO, 3.0))
        assert _names(waiting_chunks(spec, directory, MANY, 96.0)) == first
        more = grown(spec, 4)
        assert _names(waiting_chunks(more, directory, MANY, 96.0))[: len(first)] == first
        assert sorted(p for chunk in first for p in chunk) == sorted(
            unit.policy for unit in trained_units(spec)
        )
        clear(directory.path)
        assert _names(waiting_chunks(spec, directory, MANY, 96.0)) != first


def _staged(directory, unit="train-a", text="{}"):
    """A claim whose results wait."""
    desk = Desk(directory.path, DRIVEN)
    desk.open()
    claim = Claims(FolderFiles(desk.claims), [unit]).seize(unit)
    there = RunDirectory(desk.staged(claim), {})
    there.make_folders()
    (there.evidence / f"{unit}.parquet").write_text(text)
    there.finish(unit, "key", time.time(), policy="hash")
    return desk, claim


def test_what_was_decided_is_put_in_place_and_the_rest_is_not(directory):
    with directory.opened():
        _, decided = _staged(directory, "train-a")
        assert decided.commit()
        _, open_one = _staged(directory, "train-b")
        retire(directory.path, DRIVEN)
        assert directory.finished("train-a", "key") is not None
        assert directory.marker("train-b") is None
        assert not directory.has_records("train-b")
        assert open_one.number == 1
        assert not list((directory.path / ".work").iterdir())


def test_it_may_be_put_in_place_twice_and_by_two(directory):
    with directory.opened():
        desk, claim = _staged(directory)
        other = Desk(directory.path, DRIVEN)
        assert claim.commit()
        desk.put_in_place(claim)
        other.put_in_place(claim)
        assert directory.finished("train-a", "key") is not None


def test_a_unit_that_was_seized_is_not_put_in_place(directory):
    with directory.opened():
        _, first = _staged(directory, text="first")
        desk, second = _staged(directory, text="second")
        assert not first.commit()
        assert second.commit()
        desk.put_in_place(second)
        assert (directory.evidence / "train-a.parquet").read_text() == "second"
