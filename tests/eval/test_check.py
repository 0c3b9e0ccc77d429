"""What a discretization costs, measured: what is run, what is said, what is refused."""

import itertools
import json
import re

import msgspec
import numpy as np
import pytest
from house import ROOT

import integ_gym
from integ_gym.cli import main
from integ_gym.envs.settings import Discretization
from integ_gym.eval import loss_check
from integ_gym.eval.loss_check import (
    MOST_SEEDS,
    NARROW,
    Check,
    CheckedCell,
)
from integ_gym.eval.panel.conclusions import next_step
from integ_gym.eval.report.page import render
from integ_gym.eval.statistics import Estimate
from integ_gym.eval.verdict import LEARNED

SMALL = {"total_steps": 128, "n_envs": 4, "n_steps": 32, "batch_size": 64}


def small(out, **changed):
    given = {
        "integrator": "explicit_euler", "dt": 0.05, "environment": {"duration": 1.0},
        "training": SMALL, "trainer": "sb3", "seeds": 2, "out": out, "workers": 1,
        "progress": False,
    }  # fmt: skip
    return integ_gym.check(**{**given, **changed})


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    return small(tmp_path_factory.mktemp("check") / "run")


def test_it_is_judged_at_home_at_finer_steps_and_on_the_truth(finished):
    steps = [f"explicit_euler dt={dt}" for dt in (0.05, 0.025, 0.0125)]
    assert [cell.name for cell in finished.cells] == [*steps, "reference dt=0.05"]
    assert finished.exact
    assert finished.home is finished.cells[0]
    assert finished.truth is finished.cells[-1]
    home, truth = (finished.panel.entry("explicit_euler dt=0.05", cell.name).success_by_seed
                   for cell in (finished.home, finished.truth))  # fmt: skip
    assert finished.loss.estimate == pytest.approx(np.mean(home) - np.mean(truth))
    assert finished.loss.low <= finished.loss.estimate <= finished.loss.high
    assert {cell.control_period for cell in finished.panel.cells} == {0.05}


def test_the_command_says_it_in_one_line_and_runs_nothing_again(finished, capsys):
    units = finished.directory / "units"
    before = {file: file.stat().st_mtime_ns for file in units.iterdir()}
    assert (finished.directory / "report.html").exists()
    words = ["check", "--integrator", "explicit_euler", "--dt", "0.05", "--trainer", "sb3"]
    words += ["--env-arg", "duration=1.0", "--seeds", "2", "--workers", "1", "--no-progress"]
    for name, value in SMALL.items():
        words += ["--train-arg", f"{name}={value}"]
    assert main([*words, "--out", str(finished.directory)]) == 0
    assert before == {file: file.stat().st_mtime_ns for file in units.iterdir()}
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == str(finished)
    assert "2 more seeds (--seeds 4) would take about" in lines[1]
    assert any(line.startswith("home (explicit_euler dt=0.05)") for line in lines)
    assert any(line.startswith("truth ") for line in lines)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--integrator symplectic_eulr --dt 0.05", "'symplectic_euler'"),
        ("--integrator reference --dt 0.05", "`reference` is the truth itself"),
        ("--integrator rk4 --dt 0.03 --control-period 0.05", "not a whole multiple of `dt`=0.03 s"),
        ("--integrator rk4 --dt 0.05 --env-arg masss=1", "'masss'. Did you mean 'mass'"),
        ("--integrator rk4 --dt 0.05 --env-arg dt=0.1", "--dt"),
        ("--integrator rk4 --dt 0.05 --train-arg total_step=1", "Did you mean 'total_steps'"),
        ("--integrator rk4 --dt 0.05 --control-period 0", "control_period"),
        ("--integrator rk4 --dt 0.05 --seeds 0", "1 to 10000 seeds, got 0"),
        ("--integrator rk4 --dt 0.05 --env Nope-v0", "'Nope-v0'"),
    ],
)
def test_bad_input_ends_in_one_sentence(words, said, capsys, tmp_path):
    assert main(["check", *words.split(), "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err.strip()
    assert said in error
    assert "\n" not in error
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("env_id", "engine", "trainer"),
    [
        ("IntegPendulum-v0", "native", "fleet"),
        ("IntegPendulum-v0", "mujoco", "sb3"),
        ("InvertedPendulum-v5", "mujoco", "sb3"),
    ],
)
def test_stable_baselines3_trains_what_the_fleet_cannot(env_id, engine, trainer):
    home = Discretization("RK4" if engine == "mujoco" else "rk4", 0.02, 0.04, engine)
    assert loss_check.specify(env_id, home, {}, {}, None).trainer == trainer


@pytest.mark.slow
def test_without_a_reference_the_finest_step_is_what_it_is_held_against(tmp_path):
    found = small(tmp_path / "run", env_id="InvertedPendulum-v5", integrator="Euler", dt=0.02,
                  environment={})  # fmt: skip
    assert not found.exact
    assert found.truth.name == "mujoco Euler dt=0.005"
    assert "at the finest step (mujoco Euler dt=0.005)" in str(found)


def planted(panel, seeds, half_width, loss=0.4, home=1.0, truth="achievable"):
    """The panel of a check as if it had found so much."""
    lost = Estimate(loss, loss - half_width, loss + half_width, 0.95)
    away = panel.truth.name
    row = msgspec.structs.replace(
        panel.rows[0], seeds=seeds, home_success=Estimate(home), learned=home >= LEARNED
    )
    matrix = [
        msgspec.structs.replace(
            entry,
            success=Estimate(home - loss if entry.cell == away else home),
            home_drop=lost if entry.cell == away else entry.home_drop,
        )
        for entry in panel.matrix
    ]
    cells = [
        msgspec.structs.replace(cell, achievability=truth if cell.name == away else None)
        for cell in panel.cells
    ]
    told = {"rows": (row,), "matrix": tuple(matrix), "cells": tuple(cells)}
    return msgspec.structs.replace(panel, **told)


def check_of(panel, seeds):
    """A check of a planted panel."""
    entry = panel.entry(panel.rows[0].name, panel.truth.name)
    there = CheckedCell("truth", entry.success.estimate, 0.9, entry.home_drop)
    home = CheckedCell("home", panel.rows[0].home_success.estimate, 1.0, None)
    return Check(panel, None, seeds, 20, home, there, True, (home, there))


@pytest.fixture
def asked(monkeypatch, finished):
    """Seeds of the panels that a check asks for; its interval becomes narrow with the third."""
    seeds, widths = [], itertools.chain([0.3, 0.21], itertools.repeat(0.19))
    monkeypatch.setattr(loss_check, "run_panel", lambda spec, *_, **__: seeds.append(spec.seeds))

    def found(*_):
        return check_of(planted(finished.panel, len(seeds[-1]), next(widths)), len(seeds[-1]))

    monkeypatch.setattr(loss_check, "check_of", found)
    return seeds


def test_seeds_are_added_until_the_interval_is_narrow(asked, tmp_path):
    found = integ_gym.check(integrator="rk4", dt=0.05, out=tmp_path)
    assert [len(seeds) for seeds in asked] == [12, 28, 32]
    assert all(seeds == asked[-1][: len(seeds)] for seeds in asked)
    assert found.half_width <= NARROW
    asked.clear()
    integ_gym.check(integrator="rk4", dt=0.05, out=tmp_path, seeds=5)
    assert [len(seeds) for seeds in asked] == [5]


def test_an_interrupted_growth_goes_on_with_the_seeds_it_had_asked_for(asked, tmp_path):
    """The manifest knows of 28 seeds before the panel's file, which is written at the end."""
    (tmp_path / "panel.json").write_text('{"rows": [{"seeds": 12}]}')
    held = {"specification": {"seeds": list(range(28))}, "versions": {}}
    (tmp_path / "run.json").write_text(json.dumps(held))
    integ_gym.check(integrator="rk4", dt=0.05, out=tmp_path)
    assert len(asked[0]) == 28


@pytest.mark.parametrize(
    ("loss", "half_width", "home", "truth", "cause", "words"),
    [
        (0.4, 0.2, 1.0, "achievable", "yes", "dt is the cause"),
        (0.4, 0.2, 1.0, None, "yes", "dt is the cause"),
        (0.0, 0.15, 1.0, "achievable", "no", "dt is not a cause of losing more than 0.15"),
        (0.1, 0.15, 1.0, "achievable", "undecided", "12 seeds do not show whether dt is the cause"),
        (0.03, 0.02, 1.0, "achievable", "no", "dt is not the cause"),
        (0.0, 0.1, 0.3, "achievable", "undecided", "too little was learned at home"),
        (0.3, 0.1, 0.3, "achievable", "undecided", "too little was learned at home"),
        (0.9, 0.1, 1.0, "unachievable", "undecided", "the truth cannot be solved in time"),
        (0.9, 0.1, 1.0, "too_slow", "undecided", "the truth cannot be solved in time"),
        (0.9, 0.1, 1.0, "undecided", "undecided", "is not known"),
        (-0.4, 0.2, 1.0, "achievable", "no", "nothing is lost"),
    ],
)
def test_the_answer_says_whether_it_is_the_cause(
    finished, loss, half_width, home, truth, cause, words
):
    found = check_of(planted(finished.panel, 12, half_width, loss, home, truth), 12)
    assert found.cause == cause
    assert words in str(found)


def test_terminal_and_page_say_one_thing_with_one_interval(finished):
    panel = planted(finished.panel, 12, 0.2)
    assert "lost 0.40 (95 % interval 0.20 to 0.60): dt is the cause." in str(check_of(panel, 12))
    command = "integ-gym check --integrator explicit_euler --dt 0.05 --out runs/mine --seeds 12"
    panel = msgspec.structs.replace(panel, command=command)
    page = re.sub(r"<wbr>|\s+", " ", render(panel))
    assert panel.headline.rpartition(": ")[0].replace("_", "_ ") in page.replace("&nbsp;", " ")
    assert next_step(panel).command == (
        "integ-gym check --integrator explicit_euler --seeds 12 --dt 0.025 --control-period 0.05"
    )
    assert next_step(panel).command in page
    entry = finished.panel.entry(finished.panel.rows[0].name, finished.panel.truth.name)
    assert entry.home_drop == finished.loss


def test_a_check_that_learned_too_little_is_trained_twice_as_long(finished):
    command = "integ-gym check --train-arg total_steps=128 --train-arg n_envs=4 --dt 0.05"
    step = next_step(msgspec.structs.replace(finished.panel, command=command))
    assert step.command == (
        "integ-gym check --train-arg n_envs=4 --dt 0.05 --train-arg total_steps=256"
    )


@pytest.mark.parametrize(
    ("mean", "draw"),
    [
        (0.3, lambda r: (r.random(MOST_SEEDS) < 0.3).astype(float)),
        (0.5, lambda r: r.binomial(20, r.beta(1.5, 1.5, MOST_SEEDS)) / 20),
        (0.1, lambda r: r.choice([-0.5, 0.0, 0.5, 1.0], MOST_SEEDS, p=[0.2, 0.5, 0.2, 0.1])),
    ],
)
def test_the_interval_holds_the_loss_though_its_width_ends_the_check(mean, draw, monkeypatch):
    """In 0.93 to 1.00 of many more repeats; benchmarks/check_coverage.py has more worlds."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from check_coverage import checked

    generator, repeats, held = np.random.default_rng(5), 150, 0
    for _ in range(repeats):
        _, low, high = checked(draw(generator), draws=1000)
        held += low <= mean <= high
    assert held / repeats > 0.91


def test_the_page_has_the_table_of_the_eight_settings(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import check_points

    saved = (ROOT / "docs" / "atlas" / "check_points.json").read_text(encoding="utf-8")
    results = json.loads(saved)
    page = (ROOT / "docs" / "how-to" / "check.md").read_text(encoding="utf-8")
    assert "\n".join(check_points.table(results)) in page
    assert len(results) == 8
    assert sum(map(check_points.held, results)) >= 7
    assert all(0.5 * (one["high"] - one["low"]) <= NARROW for one in results)
