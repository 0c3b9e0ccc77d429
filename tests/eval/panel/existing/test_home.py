"""A policy's home is stated or unknown, never assumed, and decides labels and records."""

import json
from pathlib import Path

import numpy as np
import pytest
from stable_baselines3 import PPO

import integ_gym
from integ_gym.cli import main
from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.eval.panel.home import provenance
from integ_gym.eval.panel.policies import read_existing
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy_files.sidecar import stated_arguments
from integ_gym.train.policy_files.writing import write_sidecar

PENDULUM = "IntegPendulum-v0"
PUMPED = {"integrator": "explicit_euler", "dt": 0.05, "control_period": 0.1}


def lazy(observation):
    """Succeeds on no discretization but one that pumps energy in."""
    return np.zeros(1)


@pytest.mark.parametrize(
    ("stated", "env_id", "expected"),
    [
        (None, PENDULUM, {}),
        ("stock", "IntegCartPole-v0", {"integrator": "explicit_euler", "dt": 0.02}),
        ("stock", PENDULUM, {"integrator": "symplectic_euler", "dt": 0.05, "max_speed": 8.0}),
        ("integrator=rk4,dt=0.01", PENDULUM, {"control_period": 0.01, "engine": "native"}),
        ("integrator=rk4, dt=0.01, control_period=0.05", PENDULUM, {"control_period": 0.05}),
        (PUMPED, PENDULUM, PUMPED),
        (Discretization("rk4", 0.05, 0.1), PENDULUM, {"integrator": "rk4", "control_period": 0.1}),
        ("control_period=0.1", PENDULUM, {"control_period": 0.1}),
    ],
)
def test_a_home_is_stated_in_many_ways(stated, env_id, expected):
    arguments = stated_arguments(stated, env_id)
    assert arguments.items() >= expected.items()
    assert bool(arguments) == bool(expected)


@pytest.mark.parametrize(
    ("stated", "fragment"),
    [
        ("rk4", "cannot be read; give integrator="),
        ("integrator=rk4", "lacks `dt`"),
        ("dt=0.05,control_period=0.05", "lacks `integrator`"),
        ("integrator=rk4,dt=0.05,step=1", "unknown part of a home 'step'"),
        ("integrator=rk9,dt=0.05", "unknown integrator 'rk9'"),
        ("integrator=rk4,dt=0.05,control_period=0.07", "not a whole multiple"),
    ],
)
def test_what_is_no_home_is_refused(stated, fragment):
    with pytest.raises(ValueError, match=fragment):
        provenance(PENDULUM, None, stated, {})


def _judged(out: Path, **arguments) -> tuple[dict, list[dict]]:
    panel = integ_gym.evaluate(
        lazy, PENDULUM, out, integrators=["explicit_euler", "rk4"], dts=[0.05], episodes=3,
        environment={"start": "hanging", "duration": 3.0}, workers=1, progress=False, **arguments,
    )  # fmt: skip
    query = "SELECT cell, training_discretization AS home, failure_label AS label FROM records"
    records = EvidenceStore(out / "evidence").query(
        f"{query} WHERE policy_id = 'lazy' AND phase = 'evaluation'"
    )
    written = json.loads((out / "panel.json").read_text(encoding="utf-8"))
    assert len(repr(panel)) < 2000
    assert panel.row("lazy").home == written["rows"][0]["home"]
    return written, records.to_pylist()


@pytest.mark.slow
def test_a_stated_home_stands_in_every_record_and_is_judged_at_its_own_period(tmp_path):
    lines: list[str] = []
    panel, records = _judged(tmp_path / "o", home=PUMPED, on_home=lines.append)
    assert lines == ["home: explicit_euler dt=0.05, control period 0.1 s (stated)"]
    assert {json.loads(record["home"])["integrator"] for record in records} == {"explicit_euler"}
    assert {cell["control_period"] for cell in panel["cells"]} == {0.1}
    assert panel["rows"][0]["home"] == "explicit_euler dt=0.05"
    assert {one["against"] for one in panel["paired"]} == {"home"}
    assert {one["scope"] for one in panel["paired"]} == {"this policy, these starts"}


@pytest.mark.slow
def test_of_an_unknown_home_nothing_is_claimed(tmp_path, capsys):
    """And from Python doubts are told on stderr."""
    panel, records = _judged(tmp_path / "o")
    told, doubts = capsys.readouterr().err, panel["doubts"]
    assert len(doubts) == told.count("warning: ") > 0
    assert told.startswith("warning: the home of lazy is unknown")
    assert "3 episodes are too few to show anything, give --episodes 20 or more" in told
    assert {record["home"] for record in records} == {None}
    labels = {record["label"] for record in records}
    assert not labels & {"discretization_error", "planning_error", "control_error"}
    assert panel["rows"][0]["home"] is None
    assert panel["spec"]["home"]["discretizations"] is None
    page = (tmp_path / "o" / "report.html").read_text(encoding="utf-8")
    assert "the home of lazy is unknown" in page
    assert {one["against"] for one in panel["paired"]} == {"truth"}


def weak(observation):
    """Pumps with less torque than the truth asks for, and balances with all there is."""
    cosine, sine, speed = (float(x) for x in observation)
    if cosine > 0.85:
        return [-20.0 * sine - 4.0 * speed]
    towards = 1.0 if speed * speed / 6.0 + 5.0 * cosine < 5.0 else -1.0
    return [0.2 * towards * (1.0 if speed >= 0.0 else -1.0)]


@pytest.mark.slow
def test_what_succeeds_where_energy_is_pumped_in_fails_by_the_discretization(tmp_path):
    integ_gym.evaluate(
        weak, PENDULUM, tmp_path / "o", home="integrator=explicit_euler,dt=0.05",
        integrators=["explicit_euler", "rk4"], dts=[0.05], episodes=3, workers=1, progress=False,
        environment={"start": "hanging"},
    )  # fmt: skip
    query = (
        "SELECT cell, success, failure_label AS label FROM records "
        "WHERE policy_id = 'weak' AND phase = 'evaluation' AND perturbation IS NULL"
    )
    records = EvidenceStore(tmp_path / "o" / "evidence").query(query).to_pylist()
    at_home = [one for one in records if one["cell"] == "explicit_euler dt=0.05"]
    elsewhere = [one for one in records if one not in at_home]
    assert {one["success"] for one in at_home} == {True}
    assert {one["success"] for one in elsewhere} == {False}
    assert {one["label"] for one in elsewhere} == {"discretization_error"}


def test_a_side_car_of_anybody_s_gives_the_home_and_statistics(tmp_path, capsys):
    path = tmp_path / "mine.zip"
    PPO("MlpPolicy", "Pendulum-v1", seed=0, device="cpu").save(path)
    numbers = {"mean": [0.5, 0.0, 1.0], "var": [1.0, 2.0, 3.0], "epsilon": 1e-8, "clip_obs": 10.0}
    (tmp_path / "stats.json").write_text(json.dumps(numbers))
    written = write_sidecar(
        path, PENDULUM, home=PUMPED, environment={"max_torque": 1.5},
        obs_stats=tmp_path / "stats.json", seed=7,
    )  # fmt: skip
    assert written == tmp_path / "mine.json"
    existing = read_existing(path, PENDULUM, {})
    assert existing.home == Discretization("explicit_euler", 0.05, 0.1)
    assert existing.provenance.environment["max_torque"] == 1.5
    assert existing.seed == 7
    assert existing.policy.statistics is not None
    command = ["evaluate", str(path), "--env", PENDULUM, "--out", str(tmp_path / "o")]
    assert main([*command, "--home", "integrator=rk4,dt=0.05,control_period=0.1"]) == 2
    assert (
        "--home says rk4 dt=0.05 with control period 0.1 s and the side-car beside the policy"
        in capsys.readouterr().err
    )
    assert not (tmp_path / "o").exists()


def _card(home: object, **environment) -> dict:
    arguments = {} if home is None else dict(PUMPED)
    return {"home": home, "config": {"env_id": PENDULUM, "env_arguments": arguments | environment}}


@pytest.mark.parametrize(
    ("stated", "fragment"),
    [
        ("control_period=0.05", r"--home says control period 0\.05 s and the side-car"),
        ("unknown", r"--home says the home is unknown and .* with control period 0\.1 s"),
        ("stock", r"--home says symplectic_euler dt=0\.05 with control period 0\.05 s and"),
        (
            "integrator=explicit_euler,dt=0.05,control_period=0.05",
            r"explicit_euler dt=0\.05 with control period 0\.05 s and .* period 0\.1 s; leave out",
        ),
    ],
)
def test_no_statement_beside_a_side_car_is_ignored(stated, fragment):
    with pytest.raises(ValueError, match=fragment):
        provenance(PENDULUM, _card(PUMPED), stated, {})


def test_what_a_side_car_says_may_be_repeated():
    for stated in (None, "control_period=0.1", PUMPED):
        known, _ = provenance(PENDULUM, _card(PUMPED), stated, {})
        assert known.home == Discretization(**PUMPED, engine="native")
    stock = stated_arguments("stock", PENDULUM)
    clipped = {name: x for name, x in stock.items() if name != "max_speed"}
    card = {**_card(clipped), "config": {"env_id": PENDULUM, "env_arguments": clipped}}
    with pytest.raises(ValueError, match=r"--home says max_speed=8\.0 and the side-car max_speed="):
        provenance(PENDULUM, card, "stock", {})
    with pytest.raises(ValueError, match=r"control_period=0\.05 and the side-car control_period=0"):
        provenance(PENDULUM, _card(None, control_period=0.1), "stock", {})


def test_an_argument_that_sets_the_control_period_is_not_said_beside_the_home():
    with pytest.raises(ValueError, match=r"frame_skip=8 makes the control period 0\.016 s"):
        provenance("Hopper-v5", None, "stock", {"frame_skip": 8})
    stated = "integrator=RK4,dt=0.002,control_period=0.016"
    known, _ = provenance("Hopper-v5", None, stated, {"frame_skip": 8})
    assert known.control_period == 0.016


@pytest.mark.parametrize("env_id", ["IntegCartPoleSwingUp-v0", "IntegElasticPendulum-v0"])
def test_what_gymnasium_lacks_is_no_stock(env_id):
    with pytest.raises(ValueError, match="is no environment of Gymnasium's"):
        stated_arguments("stock", env_id)


@pytest.mark.parametrize("env_id", ["Hopper-v5", "Acrobot-v1", "mountain_car:MountainCar"])
def test_stock_is_the_task_as_its_library_makes_it(env_id):
    assert stated_arguments("stock", env_id) == find_testbed(env_id, {}).home.arguments()


def test_a_side_car_without_a_home_leaves_it_to_be_stated(tmp_path):
    path = tmp_path / "mine.zip"
    PPO("MlpPolicy", "Pendulum-v1", seed=0, device="cpu").save(path)
    write_sidecar(path, PENDULUM, home=None)
    assert read_existing(path, PENDULUM, {}).home is None
    assert read_existing(path, PENDULUM, {}, home=PUMPED).home == Discretization(
        "explicit_euler", 0.05, 0.1
    )
