"""The panel's specification."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from small_panel import small_data

import integ_gym.eval
from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.eval.panel.cells import SpecError
from integ_gym.eval.panel.plan import inputs, read_planned_spec
from integ_gym.eval.panel.run import check_spec
from integ_gym.eval.panel.spec import parse_spec, read_spec
from integ_gym.eval.panel.units import units_of
from integ_gym.support.executors import Cluster

SPECS = sorted((Path(integ_gym.eval.__file__).parent.parent / "specs").glob("*.toml"))


@pytest.mark.parametrize("path", SPECS, ids=lambda p: p.name)
def test_published_specifications_are_valid(path):
    check_spec(read_spec(path))


def test_the_fleet_trains_unless_the_specification_says_otherwise(monkeypatch):
    data = small_data()
    del data["trainer"]
    spec = parse_spec({**data, "memory_gib": 8}, "test")
    assert (spec.trainer, spec.memory_gib) == ("fleet", 8.0)
    assert spec.to_json() == parse_spec(data, "test").to_json()
    check_spec(spec, Cluster(2))
    with pytest.raises(SpecError, match="`memory_gib`=1 does not hold one policy in each of 2"):
        check_spec(replace(spec, memory_gib=1.0), Cluster(2))
    monkeypatch.setattr("integ_gym.support.optional.find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError) as caught:
        check_spec(spec)
    message = str(caught.value)
    assert 'jax is not installed; run: pip install -e ".[fleet]"; or train with' in message
    assert '--trainer sb3, or `trainer = "sb3"` in the specification' in message
    with pytest.raises(ModuleNotFoundError, match=r'pip install -e "\.\[train\]"$'):
        check_spec(replace(spec, trainer="sb3"))


class OwnEngine(NativeEngine):
    """An engine of a user's own."""

    batched = False
    horizon = None


def test_what_the_fleet_cannot_train_is_refused_with_the_other_trainer():
    train = [{"integrator": "rk4", "dt": 0.05, "engine": f"{__name__}:OwnEngine"}]
    changes = {"trainer": "fleet", "train": train, "evaluate": train, "family": [], "compare": []}
    spec = parse_spec(small_data(**changes), "test")
    with pytest.raises(SpecError, match=r"not made of JAX's operations; use --trainer sb3"):
        check_spec(spec)
    check_spec(replace(spec, trainer="sb3"))


SOLVERS = [
    {"engine": "mujoco", "integrator": "Euler", "dt": 0.05, "solver": {"iterations": [1, 100]}},
    {"integrator": "implicit_midpoint", "dt": 0.05, "solver": {"iterations": [1, 50]}},
]


def test_one_setting_of_several_solvers_varies_each_and_is_separated_where_home_has_it():
    data = small_data()
    spec = parse_spec({**data, "evaluate": [*data["evaluate"], *SOLVERS]}, "test")
    once = [one for one in spec.variations if one.name == "solver.iterations=1"]
    assert [place.engine for place in once[0].at] == ["mujoco", "native"]
    assert len(once) == 1
    for home in spec.train:
        cells = {cell.name: cell for cell in spec.cells_of(home)}
        assert "mujoco Euler dt=0.05, solver.iterations=1" in cells
        assert "implicit_midpoint dt=0.05, solver.iterations=50" in cells
        assert f"{home.name}, solver.iterations=1" not in cells


def test_cells_of_a_row_begin_at_home_and_replays_come_first():
    spec = parse_spec(small_data(), "test")
    home = spec.train[1]
    cells = spec.cells_of(home)
    names = [cell.name for cell in cells]
    assert cells[0].discretization == home
    assert len(set(names)) == len(names)
    assert names.index("rk4 dt=0.05, mass +20 %") < names.index("reference dt=0.05, mass +20 %")
    ladder = [c for c in cells if c.kind == "ladder"]
    assert [(c.discretization.dt, c.discretization.control_period) for c in ladder] == [
        (0.025, 0.025),
        (0.0125, 0.0125),
    ]
    assert {c.name for c in cells if c.role == "quarter_step"} == {
        "rk4 dt=0.0125",
        "explicit_euler dt=0.0125",
    }
    assert [c.name for c in cells if c.role == "reference"] == ["reference dt=0.05"]
    units = units_of(spec)
    assert len({unit.policy for unit in units}) == len(units) == 3 + 2 * 2


@pytest.mark.parametrize(
    ("changes", "fragments"),
    [
        ({"episode": 3}, ["unknown key 'episode'", "Did you mean 'episodes'"]),
        ({"env_id": "IntegPendulun-v0"}, ["unknown environment", "IntegPendulum-v0"]),
        ({"control_period": 0.0}, ["`float` > 0.0 - at `control_period`"]),
        ({"control_period": 0.06}, ["not a whole multiple"]),
        ({"seeds": []}, ["length >= 1 - at `seeds`"]),
        ({"seeds": [0, 0]}, ["twice"]),
        ({"baselines": ["best"]}, ["unknown baseline 'best'", "handmade"]),
        ({"family": [["rk4 dt=0.05", "no"]]}, ["unknown cell in `family`", "reference dt=0.05"]),
        ({"compare": [["rk4 dt=0.05", "rk9 dt=0.05"]]}, ["unknown training discretization"]),
        ({"environment": {"mass": -2.0}}, ["`mass`", "above 0"]),
        (
            {"training": {"learning_rat": 1}},
            ["unknown hyperparameter 'learning_rat'", "Did you mean 'learning_rate'"],
        ),
        ({"training": {"seed": 1}}, ["`seed` in `training` is set by the panel itself"]),
        ({"training": {"total_steps": 0}}, ["total_steps"]),
        ({"train": [{"integrator": "rk9", "dt": 0.05}]}, ["unknown integrator 'rk9'"]),
        ({"train": [{"integrator": "rk4"}]}, ["missing required field `dt` - at `train[0]`"]),
        (
            {"train": [{"integrator": "rk4", "dt": 0.01}], "family": [], "compare": []},
            ["must also be evaluated", "add it to `evaluate`"],
        ),
        (
            {"train": [{"integrator": "rk4", "dt": 0.05, "order": 4}]},
            ["unknown field `order` - at `train[0]`"],
        ),
        ({"family": [["rk4 dt=0.05", "rk4 dt=0.05"]]}, ["own home"]),
        (
            {"perturbations": [{"name": "x", "environment": {"mass": m}} for m in (2.0, 3.0)]},
            ["`variations` lists something twice"],
        ),
        (
            {"evaluate": [{"integrator": ["explicit_euler", "rk4"], "dt": [0.05, 0.025]}]},
            ["explicit_euler evaluated at dt=0.0125"],
        ),
        ({"episodes": True}, ["got `bool` - at `episodes`"]),
        ({"environment": [1]}, ["Expected `table`, got `list`"]),
        ({"train": [{"integrator": 4, "dt": 0.05}]}, ["at `train[0].integrator`"]),
        ({"evaluate": [{"integrator": "rk4", "dt": float("nan")}]}, ["at `evaluate[0].dt`"]),
        ({"trainer": "sb4"}, ["unknown trainer", "fleet, sb3"]),
        ({"memory_gib": 0}, ["> 0.0 - at `memory_gib`"]),
    ],
)  # fmt: skip
def test_impossible_specifications_name_the_remedy(changes, fragments):
    with pytest.raises(SpecError) as caught:
        check_spec(parse_spec(small_data(**changes), "panel.toml"))
    for fragment in fragments:
        assert fragment in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("environment", "step"),
    [
        ({}, 0.05),
        ({"action_latency": 0.05}, 0.05),
        ({"action_latency": 0.0125}, 0.0125),
        ({"latency_jitter": 0.02, "sensor_period": 0.025}, 0.005),
    ],
)
def test_the_reference_takes_a_step_that_delays_are_multiples_of(environment, step):
    grid = [{"integrator": ["explicit_euler", "rk4"], "dt": [0.05, 0.0025]}]
    fine = [{"integrator": ["explicit_euler", "rk4"], "dt": 0.0025}]
    spec = parse_spec(
        small_data(
            environment=environment, ladder=False, family=[], compare=[],
            train=fine, evaluate=fine if environment else grid,
        ),
        "test",
    )  # fmt: skip
    truth = spec.columns()[-1]
    assert truth.name == "reference dt=0.05"
    assert truth.arguments(spec.environment)["dt"] == pytest.approx(step, rel=1e-12)


def test_missing_keys_and_files_are_named(tmp_path):
    with pytest.raises(SpecError, match="missing required field `env_id`"):
        parse_spec({"name": "x"}, "x.toml")
    with pytest.raises(SpecError, match="cannot be read: No such file"):
        read_spec(tmp_path / "none.toml")
    (tmp_path / "latin.toml").write_bytes('name = "é"'.encode("latin-1"))
    with pytest.raises(SpecError, match="utf-8"):
        read_spec(tmp_path / "latin.toml")
    with pytest.raises(SpecError, match=r"/dev/zero .*: it is a device or a pipe and no file"):
        read_spec(Path("/dev/zero"))


def test_every_panel_has_its_baselines_and_checks():
    data = {k: v for k, v in small_data().items() if k not in ("baselines", "perturbations")}
    spec = parse_spec(data, "test")
    assert spec.baselines == ("random", "zero", "handmade")
    assert [p.name for p in spec.variations] == ["mass +20 %", "latency +50 ms"]
    assert [dict(p.changes) for p in spec.variations] == [
        {"mass": pytest.approx(1.2)}, {"action_latency": 0.05},
    ]  # fmt: skip
    assert spec.gaps() == []
    bare = parse_spec(small_data(baselines=["zero"], perturbations=[]), "test")
    gaps = " ".join(bare.gaps())
    for fragment in ("'random'", "'handmade'", "perturbation of the plant", "action latency"):
        assert fragment in gaps
    short = parse_spec(small_data(environment={"duration": 1.0}), "test")
    assert "no episode can succeed" in short.gaps()[0]


@pytest.mark.parametrize(
    ("changes", "fragment"),
    [
        ({"environment": {"integrator": "rk4"}}, "`environment` gives `integrator`"),
        ({"environment": {"mixture": []}}, "`environment` gives `mixture`"),
        ({"seeds": [2**32]}, "`int` <= 4294967295 - at `seeds[0]`"),
        (
            {"evaluate": [{"integrator": ["explicit_euler", "rk4"], "dt": [0.05, 0.05 + 1e-13]}]},
            "lists something twice",
        ),
        (
            {
                "control_period": 0.04,
                "train": [{"integrator": ["explicit_euler", "rk4"], "dt": 0.01}],
                "evaluate": [{"integrator": ["explicit_euler", "rk4"], "dt": 0.01}],
                "family": [], "compare": [["rk4 dt=0.01", "explicit_euler dt=0.01"]],
                "ladder": False, "perturbations": [],
            },
            "evaluated at dt=0.0025 or finer",
        ),
    ],
)  # fmt: skip
def test_what_would_only_fail_or_mislead_later_is_refused(changes, fragment):
    with pytest.raises(SpecError, match=re.escape(fragment)):
        check_spec(parse_spec(small_data(**changes), "panel.toml"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a = " + "[" * 5000, "recursion"),
        ("a = " + "1" * 5000, "4300 digits"),
        ("a = 1\n" * 300_000, "has more than 1048576 bytes"),
        ("a = ", "is no TOML"),
    ],
)
def test_files_that_are_no_specification_are_refused(tmp_path, content, message):
    file = tmp_path / "spec.toml"
    file.write_text(content)
    with pytest.raises(SpecError, match=message) as refused:
        read_spec(file)
    assert str(file) in str(refused.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"episodes": 10**9}, "`episodes` must be at most 10000"),
        (
            {"seeds": list(range(100_000)), "episodes": 10_000},
            "days of one core, and at most 10000 runs and 365",
        ),
        ({"environment": {"duration": 1e9}}, "more than 1e.09 control periods"),
        ({"training": {"total_steps": 10**13}}, "days of one core, and at most 10000 runs and 365"),
        ({"training": {"net_arch": [10**9]}}, "whole numbers, from 1 to 4096"),
    ],
)
def test_what_nobody_could_wait_for_is_refused_at_once(changes, message):
    with pytest.raises(SpecError, match=message):
        check_spec(parse_spec(small_data(**changes), "test"))


def test_planned_looks_are_kept_and_records_do_not_depend_on_them():
    planned = parse_spec(small_data(looks=[5, 42]), "test")
    assert planned.looks == (5, 42)
    assert read_planned_spec(planned.to_json()) == replace(planned, memory_gib=None)
    without = replace(planned, looks=())
    assert "looks" not in without.to_json()
    assert inputs(planned, planned.columns()) == inputs(without, planned.columns())


@pytest.mark.parametrize("looks", [[42, 42], [4, 42]])
def test_looks_that_cannot_be_are_refused(looks):
    with pytest.raises(SpecError, match="`looks` must hold numbers of seeds from 5 on"):
        parse_spec(small_data(looks=looks), "test")
