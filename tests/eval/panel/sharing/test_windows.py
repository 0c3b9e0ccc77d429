"""Whoever wakes while it finds out what is to be done, or after all is done, changes nothing."""

from __future__ import annotations

import json

import pytest
from shared_panel import specification

from integ_gym.eval.panel.running.division import noted_division
from integ_gym.eval.panel.running.run_directory import RunDirectory
from integ_gym.eval.panel.running.staging import DRIVEN, SHARED, Desk, clear, retire
from integ_gym.eval.panel.sharing.planning import training_and_division
from integ_gym.eval.panel.sharing.shared_unit import SharedUnit
from integ_gym.eval.panel.specification.reading import read_spec
from integ_gym.evidence.verification.sealing import seal
from integ_gym.support.sharing.folder_files import Gone
from integ_gym.train.fleet.worker import Workers


@pytest.fixture
def spec(tmp_path):
    return read_spec(specification(tmp_path))


@pytest.fixture
def directory(tmp_path, spec):
    return RunDirectory(tmp_path / "run", spec.to_json())


def test_the_plan_that_was_made_first_counts_with_its_division(spec, directory):
    with directory.joined():
        desk = directory.desk
        desk.open()
        units, first = training_and_division(spec, directory, Workers(2, "cpu"), 3.0)
        _, other = training_and_division(spec, directory, Workers(64, "cpu"), 96.0)
        assert first != other
        assert noted_division(directory) is None, "it is noted by whose plan counts"
        assert desk.plan("0", [unit.plain() for unit in units], 128, first)
        assert not desk.plan("0", [], 128, other)
        assert [SharedUnit.of(one) for one in desk.planned("0")["units"]] == units
        assert desk.division() == json.loads(json.dumps(first))


@pytest.mark.parametrize("over", [clear, lambda run: retire(run, SHARED)])
def test_a_desk_that_is_gone_takes_no_plan(directory, over):
    with directory.joined():
        desk = directory.desk
        desk.open()
        over(directory.path)
        for late in (lambda: desk.plan("0", []), lambda: desk.planned("0"), desk.check):
            with pytest.raises(Gone):
                late()


def test_the_seal_of_a_run_that_was_finished_meanwhile_stays(directory):
    with directory.joined():
        directory.desk.open()
        clear(directory.path)
        seal(directory.path)
        directory.lift_seal(directory.desk.root)
        assert (directory.path / "seal.json").exists()


def test_a_seal_is_lifted_while_work_is_under_way(directory):
    with directory.joined():
        directory.desk.open()
        seal(directory.path)
        directory.lift_seal(directory.desk.root)
        assert not (directory.path / "seal.json").exists()


def test_nothing_is_removed_by_one_that_was_overtaken(directory):
    with directory.joined():
        records = directory.evidence / "evaluate-a.parquet"
        records.touch()
        directory.is_ours = lambda: False
        for late in (
            lambda: directory.discard_unmarked("evaluate-"),
            lambda: directory.discard_remains("evaluate-a"),
        ):
            with pytest.raises(Gone):
                late()
        assert records.exists()
        directory.is_ours = lambda: True
        directory.discard_unmarked("evaluate-")
        assert not records.exists()


def test_plans_of_a_driver_follow_each_other(directory):
    with directory.opened():
        desk = Desk(directory.path, DRIVEN)
        desk.open()
        assert [desk.add_plan([]) for _ in range(3)] == ["0", "1", "2"]
