"""Pages of published experiments: their tables come from the published rows by the command."""

from __future__ import annotations

import ast
import importlib
import json
import re
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from functools import cache, partial

import gymnasium as gym
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from house import ROOT
from pictures import look_alike

from integ_gym.eval import contract

PAGES = {
    "learned_engines": ROOT / "docs" / "explanation" / "learned_engines.md",
    "learned_periods": ROOT / "docs" / "explanation" / "control_periods.md",
    "simulation_tools": ROOT / "docs" / "explanation" / "simulation_tools.md",
}
FOLDERS = ROOT / "docs" / "tables"


@pytest.fixture
def experiment(request, import_experiment):
    return request.param, import_experiment(request.param)


@pytest.mark.parametrize("experiment", PAGES, indirect=True)
def test_a_page_shows_what_the_rows_come_to_and_nothing_else(experiment):
    name, module = experiment
    rows = pq.read_table(FOLDERS / name / "rows.parquet").to_pylist()
    page, made = PAGES[name].read_text(encoding="utf-8"), module.tables(rows)
    for part in made.strip().split("\n\n"):
        assert part in page
    shown = {line for line in page.split("\n") if line.startswith("|") and "---" not in line}
    by_hand = shown - {*made.split("\n")}
    if name != "learned_engines":
        assert not by_hand
        return
    stops, of_rebounds = (importlib.import_module(one) for one in ("stop_damping", "cart_stops"))
    alone = pq.read_table(FOLDERS / "stop_damping" / "rows.parquet").to_pylist()
    by_hand -= {*stops.tables(alone).split("\n")}
    described = {line for line in by_hand if line.count(" | ") == 2}
    assert len(described) == 1 + len(module.ENGINES)
    for engine in module.ENGINES:
        (line,) = [one for one in described if one.startswith(f"| {engine.name}")]
        integrator, step = line.split(" | ")[1].split(" (")[0].split(", ")
        assert step == ("1/240 s" if engine.name == "pybullet" else f"{1e3 * engine.dt:g} ms")
        assert integrator.strip("`").lower() in (engine.integrator.lower(), "its only integrator")
    with closing(gym.make(module.ENV_ID)) as env:
        settings = env.unwrapped.setup.settings
    native = f"{1e3 * settings.dt:g} ms does not divide the control period"
    assert f"{settings.integrator.upper()}, 25 ms (the default of {native})" in page
    assert len(by_hand - described) == len(of_rebounds.list_settings()) + 1


@pytest.mark.parametrize("experiment", ["learned_engines"], indirect=True)
def test_how_fast_a_cart_leaves_stops_is_as_the_page_says(experiment):
    stops, page = importlib.import_module("cart_stops"), PAGES["learned_engines"].read_text("utf-8")
    found = stops.measure_rebounds()
    for name, by_speed in found.items():
        (line,) = re.findall(rf"^\| {name} \|( [\d.]+–.*)\|$", page, re.MULTILINE)
        said = [[float(x) for x in cell.split("–")] for cell in line.split("|")]
        measured = [(min(one), max(one)) for one in by_speed.values()]
        assert np.array(said) == pytest.approx(np.array(measured), abs=0.011)
    shares = {name: np.array([*by_speed.values()]) for name, by_speed in found.items()}
    assert np.ptp([shares["native"], shares["native, exact"]], axis=0).max() < 0.045
    assert (shares["native"].min().round(2), shares["native"].max().round(2)) == (0.45, 0.86)
    assert shares["native, exact, damped"].max() < 0.2
    assert shares["mujoco"].max() < 0.115
    assert max(shares["drake"].max(), shares["dart"].max()) < 0.005


@pytest.mark.parametrize("experiment", PAGES, indirect=True)
def test_a_figure_is_drawn_from_the_published_rows(experiment, tmp_path):
    name, module = experiment
    module.figure(pq.read_table(FOLDERS / name / "rows.parquet").to_pylist(), tmp_path / "figure")
    assert look_alike(FOLDERS / name / "figure.png", tmp_path / "figure.png")


@pytest.mark.parametrize("experiment", PAGES, indirect=True)
def test_a_run_of_one_block_shows_what_was_run_and_no_table_without_rows(experiment, tmp_path):
    name, module = experiment
    table = module.TABLE
    rows = pq.read_table(FOLDERS / name / "rows.parquet").to_pylist()
    block = table.units(table.first_seed)[-1].block
    units = {unit.name for unit in table.units(table.first_seed) if unit.block == block}
    of_block = [row for row in rows if row["unit"] in units]
    made = module.tables(of_block)
    assert block in made
    for part in made.strip().split("\n\n"):
        _, rule, *lines = part.split("\n")
        assert set(rule) == {"|", "-"}
        assert lines
    module.figure(of_block, tmp_path / "figure")
    assert (tmp_path / "figure.png").exists()


@pytest.mark.parametrize("experiment", PAGES, indirect=True)
def test_rows_are_of_what_is_declared(experiment):
    name, module = experiment
    found = json.loads((FOLDERS / name / "specification.json").read_text(encoding="utf-8"))
    table = module.TABLE
    assert found["declared"] == table.specification(table.first_seed)["declared"]
    block_of = {unit.name: unit.block for unit in table.units(table.first_seed)}
    units = set(pq.read_table(FOLDERS / name / "rows.parquet")["unit"].to_pylist())
    assert {block_of[unit] for unit in units} == found["instruction_sets"].keys()


@pytest.mark.parametrize("name", PAGES)
def test_who_reads_the_rows_alone_finds_the_page_s_numbers(name):
    script = ROOT / "benchmarks" / "tables" / f"read_{name}.py"
    nodes = list(ast.walk(ast.parse(script.read_text(encoding="utf-8"))))
    imported = {a.name for node in nodes if isinstance(node, ast.Import) for a in node.names}
    imported |= {f"{node.module}" for node in nodes if isinstance(node, ast.ImportFrom)}
    allowed = {*sys.stdlib_module_names, "numpy", "pyarrow"}
    assert {module.split(".")[0] for module in imported} <= allowed
    done = subprocess.run(
        [sys.executable, str(script), str(FOLDERS / name)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    page = PAGES[name].read_text(encoding="utf-8")
    assert done.stdout.strip() in page


@pytest.mark.parametrize("experiment", ["learned_engines"], indirect=True)
def test_a_step_of_an_engine_is_of_the_map_that_it_is_trained_by(experiment):
    _, module = experiment
    asked = module.units(module.TABLE.first_seed)
    assert len({unit.name for unit in asked}) == len(asked)
    for unit in {(unit.task, unit.arm, unit.trained_on): unit for unit in asked}.values():
        if unit.map is not None:
            given = module.arguments(unit.task, unit.arm, unit.trained_on)
            assert module.defect(given, unit.map) < 2e-6
    for name in ("pybullet", "sapien"):
        with pytest.raises(RuntimeError, match="is not one of symplectic_euler"):
            module.defect(module.arguments("swing-up", "as got", name), "symplectic_euler")
    differs = module.contract("short track", "matched", "native", "mujoco")["differs"]
    assert not differs


@pytest.mark.parametrize("folder", ["learned_engines", "learned_engines/again"])
@pytest.mark.parametrize("experiment", ["learned_engines"], indirect=True)
def test_what_the_page_says_of_hidden_terms_is_in_the_rows(experiment, folder):
    _, module = experiment
    rows = pq.read_table(FOLDERS / folder / "rows.parquet").to_pylist()
    damped, cells = {"pybullet", "sapien"}, module.Cells(rows, module.TABLE.cell_columns)
    for row in rows:
        assert not row["differs"]
        hidden = damped & {row["trained_on"], row["judged_on"]}
        assert row["silent"] == ("acceleration" if hidden else "")
    plain = set(module.NAMED) - damped
    own_stops = plain - {"native"}
    for task, arm, home in sorted({tuple(row[name] for name in module.NAMES[:3]) for row in rows}):
        success = {to: np.array(cells.rates(task, arm, home, to)) for to in module.NAMED}
        means = {to: np.mean(rates) for to, rates in success.items()}
        if arm == "matched":
            assert np.ptp(list(success.values()), axis=0).max() < 1.5 / 20
            continue
        assert means["sapien"] == 0.0
        assert home != "sapien" or not any(means.values())
        if task == "short track":
            alike = own_stops if home in own_stops else {home}
            assert home == "pybullet" or means["pybullet"] == 0.0
            assert all(means[to] < 0.3 for to in plain - alike)
            assert home == "sapien" or means[home] > 0.6
        else:
            alike = plain if home in plain else {home}
            assert home == "pybullet" or means["pybullet"] < 0.25
            assert all(means[to] < 0.25 for to in plain - alike)
            assert home != "pybullet" or means[home] > 0.9
        assert all(abs(means[home] - means[to]) < 0.05 for to in alike)


@pytest.mark.parametrize("experiment", ["learned_engines"], indirect=True)
def test_the_contract_check_of_a_short_track_meets_no_stop(experiment, monkeypatch):
    _, module = experiment
    drawn, draw_states = [], contract._draw_states

    def keep(*given):
        places, actions = draw_states(*given)
        drawn.extend(places)
        return places, actions

    monkeypatch.setattr(contract, "_draw_states", keep)
    for home in module.NAMED:
        module.contract.__wrapped__("short track", "as got", home, "drake")
    assert len(drawn) == contract.STATES * len(module.NAMED)
    limit = module.TASKS["short track"].track_limit
    assert 0.5 * limit < max(abs(place[0]) for place in drawn) < limit


@pytest.mark.parametrize("experiment", ["learned_periods"], indirect=True)
def test_what_the_page_says_of_late_commands_is_in_the_rows(experiment):
    _, module = experiment
    rows = pq.read_table(FOLDERS / "learned_periods" / "rows.parquet").to_pylist()
    late = {}
    for row in rows:
        if row["delay"] == 1 and row["judged_at"] == module.TASKS[row["task"]].periods[0]:
            of = row["task"], row["algorithm"], row["arm"], row["trained_at"]
            late.setdefault(of, []).append(row["successes"] / row["starts"])
    best = {
        task: max(np.mean(x) for of, x in late.items() if of[0] == task) for task in module.TASKS
    }
    for task in ("pendulum", "cart-pole", "quadrotor", "cart-pole swing-up"):
        assert best[task] == 0.0
        assert (task, "hand-made", "designed", module.TASKS[task].periods[0]) in late
    assert 0.0 < best["acrobot"] < 0.3 < best["elastic pendulum"]


@pytest.mark.parametrize("folder", ["simulation_tools", "simulation_tools/again"])
@pytest.mark.parametrize("experiment", ["simulation_tools"], indirect=True)
def test_what_the_page_says_of_tools_is_in_the_rows(experiment, folder):
    _, module = experiment
    rows = pq.read_table(FOLDERS / folder / "rows.parquet").to_pylist()
    cells = module.Cells(rows, module.TABLE.cell_columns)

    median = partial(module.median, cells)

    def speed_of_arrival(seed):
        return module.GRAVITY * module.rigid(module.start_of("box", seed))[0]

    def of_box(engine, integrator, quantity):
        return [median("box", engine, integrator, dt, quantity) for dt in (0.004, 0.002, 0.001)]

    for integrator in ("Euler", "RK4"):
        for other in ("mjx", "mujoco_warp", "isaaclab"):
            theirs = integrator if other != "isaaclab" else integrator.lower()
            for quantity in ("from the truth", "penetration", "bounce"):
                own = of_box("mujoco", integrator, quantity)
                assert own == pytest.approx(of_box(other, theirs, quantity), rel=0.05)
    for shrinks in (("dart", "semi_implicit_euler"), ("drake", "tamsi")):
        sunk = of_box(*shrinks, "penetration")
        assert sunk[0] > sunk[1] > sunk[2]
        assert sunk[0] > 2.0 * sunk[2]
        for dt in module.STEPS["box"]:
            for row in cells.by_cell["box", *shrinks, dt, "penetration"]:
                within_a_step = speed_of_arrival(row["seed"]) * dt
                assert row["value"] < 1.05 * within_a_step or row["value"] == np.inf
    assert min(of_box("mujoco", "RK4", "penetration")) > 3e-3
    assert of_box("newton", "featherstone", "bounce")[0] > 2.9
    own, true = (
        of_box("mujoco", "RK4", f"from {what}")[1] for what in ("its finest step", "the truth")
    )
    assert 5.0 * own < true
    for block in ("chain-2", "chain-5", "chain-10"):
        for one, other in ((("native", "symplectic_euler"), ("dart", "semi_implicit_euler")),
                           (("native", "rk4"), ("pinocchio", "rk4"))):  # fmt: skip
            ends = [median(block, *of, 0.002, "from the truth") for of in (one, other)]
            assert ends[0] == pytest.approx(ends[1], rel=0.02)
    worse = [median("chain-2", "casadi", "cvodes", dt, "from the truth") for dt in (0.01, 0.001)]
    assert worse[0] < worse[1]


def assert_comparison_is_shown(name, repeated):
    """Of the published rows with a folder beside them: a page has what the command prints."""
    folder, script = FOLDERS / name, ROOT / "benchmarks" / "tables" / f"{name}.py"
    command = [sys.executable, str(script), "--out", str(folder)]
    done = subprocess.run(
        [*command, "--against", str(folder / repeated)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() in PAGES[name].read_text(encoding="utf-8")


@pytest.mark.parametrize("name", PAGES)
def test_what_was_run_again_on_other_seeds_agrees_as_the_page_says(name):
    assert_comparison_is_shown(name, "again")
    folder = FOLDERS / name
    seeds = [
        {row["seed"] for row in pq.read_table(one / "rows.parquet").to_pylist()}
        for one in (folder, folder / "again")
    ]
    assert not seeds[0] & seeds[1]


def test_what_was_run_again_on_another_processor_agrees_as_the_page_says():
    assert_comparison_is_shown("learned_periods", "other_processor")
    folder = FOLDERS / "learned_periods"
    abouts = [
        json.loads((one / "specification.json").read_text(encoding="utf-8"))
        for one in (folder, folder / "other_processor")
    ]
    assert abouts[0]["declared"] == abouts[1]["declared"]
    before, after = (about["instruction_sets"] for about in abouts)
    assert before.keys() == after.keys()
    for block, sets in before.items():
        added = ["AVX512_SPR"] if block.endswith("-SAC") else []
        assert [*sets, *added] == after[block]


@pytest.mark.slow
@pytest.mark.parametrize("experiment", ["learned_engines"], indirect=True)
def test_both_tasks_can_be_done_in_every_engine_as_its_users_get_it(experiment):
    _, module = experiment
    trained, by_hand = (
        importlib.import_module(f"measuring.{one}") for one in ("trained", "swing_up")
    )

    def successes(task, controller, engine, seeds=1):
        given, first = module.arguments(task, "as got", engine), module.TABLE.first_seed
        tried = range(first, first + seeds)
        acts = seeds * [controller.act]
        return sum(trained.count_successes(module.ENV_ID, given, acts, tried)) / seeds

    for engine in module.NAMED:
        assert successes("swing-up", by_hand.DEFAULT_TRACK, engine) == trained.STARTS
        if engine != "sapien":
            assert successes("short track", by_hand.SHORT_TRACK, engine) == trained.STARTS
    in_physx = successes("short track", by_hand.SHORT_TRACK_IN_PHYSX, "sapien", seeds=4)
    assert in_physx / trained.STARTS == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("experiment", ["simulation_tools"], indirect=True)
def test_what_is_measured_of_a_tool_is_what_is_known_of_it(experiment, monkeypatch):
    """By one start: orders of convergence, a box that rests where it must, and a refusal."""
    _, module = experiment
    monkeypatch.setattr(module, "STARTS", 1)

    @cache
    def rows_of(*unit):
        return module.run(module.Unit(*unit, 900))

    def medians(block, engine, integrator, quantity):
        rows = rows_of(block, engine, integrator)
        return {row["dt"]: row["value"] for row in rows if row["quantity"] == quantity}

    for block in ("chain-2", "servo"):
        for name, order in (("symplectic_euler", 1), ("rk4", 4)):
            off = medians(block, "native", name, "from the truth")
            assert np.log2(off[0.01] / off[0.005]) == pytest.approx(order, abs=0.35)
    same = [
        medians("chain-2", *one, "from the truth")[0.01]
        for one in (("native", "symplectic_euler"), ("mujoco", "Euler"))
    ]
    assert same[0] == pytest.approx(same[1], rel=1e-6)
    assert medians("box", "sapien", "pgs", "from the truth")[0.001] < 2e-3
    assert medians("box", "mujoco", "Euler", "penetration")[0.001] > 1e-3
    rows = module.run(module.Unit("box", "drake", "tamsi", 6003))
    lost = {row["dt"] for row in rows if row["value"] == np.inf}
    assert lost == {0.004}
    assert "its solver gave up from 1 of 1 starts" in module.tables(rows)
    (row,) = module.run(module.Unit("box", "casadi", "rk", 900))
    assert "no rigid contact of its own" in row["why"]


@pytest.mark.parametrize("experiment", ["simulation_tools"], indirect=True)
def test_a_time_has_that_of_a_process_in_which_an_engine_lives(experiment):
    clocks = importlib.import_module("measuring.processor_time")
    works = "import time\ninput()\nwhile time.process_time() < 1.0: pass\nprint()\ninput()"
    with subprocess.Popen(
        [sys.executable, "-c", works], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as engine:
        known = clocks.processor_clocks()
        begun = clocks.read_clocks(known)
        engine.stdin.write("\n")
        engine.stdin.flush()
        engine.stdout.readline()
        assert 0.5 < clocks.read_clocks(known) - begun < 2.0
        engine.stdin.write("\n")


@pytest.mark.parametrize("experiment", ["simulation_tools"], indirect=True)
def test_what_is_not_installed_is_left_out_and_not_kept_as_a_result(experiment, tmp_path, capsys):
    _, module = experiment
    tables = importlib.import_module("measuring.tables")
    unit = module.Unit("chain-2", "isaaclab", "euler", 900)
    why = "isaaclab is not installed"
    table = replace(module.TABLE, units=lambda first_seed: [unit], lacking=lambda unit: why)
    assert tables.run_missing(table, tmp_path, 900) == 0
    assert f"{unit.name} is left out: {why}" in capsys.readouterr().out
    assert not tables.Folder(tmp_path).rows()


@pytest.mark.parametrize("experiment", ["simulation_tools"], indirect=True)
def test_two_runs_are_compared_by_the_intervals_of_their_medians(experiment):
    tables = importlib.import_module("measuring.tables")
    assert tables.medians_agree([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [6.0, 7.0, 8.0, 9.0, 10.0, 11.0])
    assert not tables.medians_agree(
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [6.1, 7.0, 8.0, 9.0, 10.0, 11.0]
    )
    assert tables.format_median([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) == "3.5e+00 (1.0e+00–6.0e+00)"
    assert tables.format_median([1.0, 2.0, 3.0, 4.0, 5.0, np.inf]) == "3.5e+00 (1.0e+00–lost)"


@pytest.fixture
def run_block(tmp_path):
    """Run a block, and what it printed: of its table, or why it was refused."""
    script = ROOT / "benchmarks" / "tables" / "learned_periods.py"
    command = [sys.executable, str(script), "--out", str(tmp_path), "--workers", "1"]
    command += ["--only", "cart-pole-hand-made"]

    def run(*more):
        done = subprocess.run([*command, *more], capture_output=True, text=True, check=False)
        return done.stderr if done.returncode else done.stdout

    return run


@pytest.mark.slow
def test_a_block_is_run_and_one_that_is_there_is_not_run_again(run_block):
    first = run_block()
    assert "| cart-pole |" in first
    assert run_block() == first
    assert "was made with other declared; give another folder" in run_block("--first-seed", "1")


@pytest.mark.slow
def test_a_block_is_ended_on_a_processor_like_the_one_it_was_begun_on(run_block, tmp_path):
    first, path = run_block(), tmp_path / "specification.json"
    file, about = tmp_path / "rows.parquet", json.loads(path.read_text(encoding="utf-8"))
    rows = pq.read_table(file).to_pylist()
    elsewhere = {"cart-pole-hand-made": ["another"], "pendulum-hand-made": ["a third"]}
    path.write_text(json.dumps({**about, "instruction_sets": elsewhere}), encoding="utf-8")
    assert run_block() == first
    begun = [row for row in rows if row["unit"] == rows[0]["unit"]]
    pq.write_table(pa.Table.from_pylist(begun), file)
    assert "cart-pole-hand-made of" in (refused := run_block())
    assert "was begun on a processor with other instruction sets" in refused
    path.write_text(json.dumps(about), encoding="utf-8")
    assert run_block() == first
    file.unlink()
    path.write_text(json.dumps({**about, "instruction_sets": elsewhere}), encoding="utf-8")
    assert run_block() == first
    found = json.loads(path.read_text(encoding="utf-8"))["instruction_sets"]
    assert found == {**elsewhere, **about["instruction_sets"]}


@pytest.mark.parametrize("experiment", ["learned_engines", "learned_periods"], indirect=True)
def test_blocks_of_a_repetition_are_those_of_the_first_seed_that_it_declares(experiment):
    name, module = experiment
    folder = FOLDERS / name / "again"
    about = json.loads((folder / "specification.json").read_text(encoding="utf-8"))
    rows = pq.read_table(folder / "rows.parquet").to_pylist()
    blocks, *_ = module.tables(rows, about["declared"]["first_seed"]).split("\n\n")
    counts = dict(re.findall(r"^\| (\S+) \| (\d+) of ", blocks, re.MULTILINE))
    assert {block for block, count in counts.items() if int(count)} == {*about["instruction_sets"]}


def test_a_run_whose_time_is_over_fails_and_says_how_many_units_are_left(tmp_path):
    script = ROOT / "benchmarks" / "tables" / "learned_periods.py"
    command = [sys.executable, str(script), "--out", str(tmp_path), "--minutes", "0"]
    command += ["--workers", "2", "--only", "cart-pole-hand-made"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "| cart-pole-hand-made | 0 of 5 | 0 |" in done.stdout
    said = done.stderr.strip().split("\n")
    assert said[-2:] == [
        "0 units in 0.0 min with 2 processes", "5 units are left: run the same command again."
    ]  # fmt: skip
    assert not (tmp_path / "rows.parquet").exists()
