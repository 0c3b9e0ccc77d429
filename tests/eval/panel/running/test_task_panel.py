"""A panel on a MuJoCo task of Gymnasium's: trained, evaluated and told like any other."""

import json
import re
import sys
import tomllib
from pathlib import Path

import gymnasium as gym
import pytest
from engine_cases import needs
from house import ROOT
from small_panel import ALONE, small_data

from integ_gym.cli import main
from integ_gym.envs import environment as lookup
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.testbeds import making
from integ_gym.eval.panel.cells import SpecError
from integ_gym.eval.panel.run import check_spec
from integ_gym.eval.panel.spec import parse_spec
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.baselines import has_handmade, make_baseline, possible_baselines

TOML = """
name = "a task"
env_id = "InvertedPendulum-v5"
control_period = 0.04
seeds = [0, 1]
episodes = 3
trainer = "sb3"
family = [["mujoco RK4 dt=0.02", "mujoco Euler dt=0.01"]]

[environment]
max_episode_steps = 60

[training]
total_steps = 256
n_envs = 4
n_steps = 32
batch_size = 64

[[train]]
integrator = ["Euler", "RK4"]
dt = 0.02

[[train]]
mixture = "both"
members = [{ integrator = "Euler", dt = [0.02, 0.01] }]

[[evaluate]]
integrator = ["Euler", "RK4"]
dt = [0.02, 0.01]
"""
CELLS = [f"mujoco {name} dt={dt}" for name in ("Euler", "RK4") for dt in ("0.02", "0.01")]
LIMIT = [f"mujoco RK4 dt={dt}, tight solver" for dt in ("0.005", "0.0025", "0.00125")]
"""Its steps, of which the last is the column."""


@pytest.fixture(autouse=True)
def _mujoco(tmp_path, monkeypatch):
    """In a folder of its own: MuJoCo's compiler writes a file where it has a remark on a model."""
    needs("mujoco")
    monkeypatch.chdir(tmp_path)


def _spec(**changes):
    return parse_spec({**tomllib.loads(TOML), **changes}, "test")


def test_a_specification_is_filled_in_from_the_task():
    spec = _spec()
    check_spec(spec)
    assert [cell.name for cell in spec.columns()] == [*CELLS, LIMIT[-1]]
    assert spec.reference is None
    assert spec.baselines == ("random", "zero")
    assert spec.variations == ()
    kinds = {cell.name: cell.kind for cell in spec.cells_of(spec.train[0])}
    assert kinds == dict.fromkeys(CELLS, "grid") | dict.fromkeys(LIMIT, "limit")
    assert "no reference solution" in spec.gaps()[0]
    assert list(spec.engine_versions()) == ["mujoco"]


@pytest.mark.parametrize(
    ("changes", "fragment"),
    [
        ({"control_period": 0.05}, "`control_period`=0.05 s is not a whole multiple"),
        ({"env_id": "CartPole-v1"}, "unknown integrator of ClassicControl"),
        ({"environment": {"mass": 2.0}}, "Gymnasium cannot make"),
        ({"trainer": "fleet"}, "--trainer sb3"),
        (
            {"compare": [["mujoco Euler dt=0.02", "mujoco RK4 dt=0.02"]]},
            "decided on the truth, and InvertedPendulum-v5 has none; leave it out",
        ),
        ({"training": {"algorithm": "sax"}}, "unknown `algorithm` in `training` 'sax'. Did you"),
        ({"training": {"algorithm": "sac"}, "trainer": "fleet"}, "does not train by SAC; take"),
        ({"training": {"algorithm": "sac", "n_epochs": 2}}, "unknown hyperparameter 'n_epochs'"),
    ],
)
def test_what_a_task_cannot_have_is_refused(changes, fragment):
    with pytest.raises(SpecError) as caught:
        check_spec(_spec(**changes))
    assert fragment in str(caught.value)


PPO = "n_steps = 32\nbatch_size = 64"
SAC = 'algorithm = "sac"\nlearning_starts = 64\nbatch_size = 32'


@pytest.mark.slow
def test_a_task_goes_from_training_to_the_page(tmp_path):
    """By SAC: other panels are trained by PPO."""
    assert PPO in TOML
    (tmp_path / "task.toml").write_text(TOML.replace(PPO, SAC), encoding="utf-8")
    out = tmp_path / "out"
    command = ["panel", str(tmp_path / "task.toml"), "--out", str(out), *ALONE]
    assert main(command) == 0
    panel = json.loads((out / "panel.json").read_text(encoding="utf-8"))
    assert [row["name"] for row in panel["rows"]] == [CELLS[0], CELLS[2], "both", "random", "zero"]
    assert {cell["name"] for cell in panel["cells"]} == {*CELLS, *LIMIT}
    assert {one["row"] for one in panel["limits"]} == {row["name"] for row in panel["rows"]}
    assert [verdict["verdict"] for verdict in panel["verdicts"]]
    store = EvidenceStore(out / "evidence")
    assert store.verify() == []
    counts = store.query(
        "SELECT phase, cell, count(DISTINCT policy_id) AS policies FROM records "
        "WHERE phase = 'evaluation' GROUP BY ALL ORDER BY cell"
    ).to_pylist()
    assert {c["cell"]: c["policies"] for c in counts} == dict.fromkeys([*CELLS, *LIMIT], 8)
    ran = store.query(
        "SELECT DISTINCT integrator, dt, control_period, training_discretization AS home "
        "FROM records WHERE phase = 'training'"
    ).to_pylist()
    assert {(r["integrator"], r["dt"]) for r in ran} == {
        ("Euler", 0.02), ("RK4", 0.02), ("Euler", 0.01),
    }  # fmt: skip
    for record in ran:
        home = json.loads(record["home"])
        places = [(h["integrator"], h["dt"]) for h in (home if isinstance(home, list) else [home])]
        assert (record["integrator"], record["dt"]) in places
        assert record["control_period"] == 0.04
    cards = [json.loads(path.read_text()) for path in (out / "policies").glob("*/policy.json")]
    assert {card["algorithm"] for card in cards} == {"SAC"}
    assert len({card["content_hash"] for card in cards}) == len(cards) == 6
    assert "InvertedPendulum-v5" in (out / "report.html").read_text(encoding="utf-8")

    policy = out / "policies" / "mujoco-RK4-dt-0.02-seed1" / "policy.zip"
    given = ["evaluate", str(policy), "--env", "InvertedPendulum-v5", "--episodes", "2"]
    chosen = ["--integrator=Euler", "--dt=0.02", "--out", str(tmp_path / "one"), "--no-progress"]
    assert main([*given, *chosen]) == 0
    one = json.loads((tmp_path / "one" / "panel.json").read_text(encoding="utf-8"))
    assert one["rows"][0]["home"] == "mujoco RK4 dt=0.02"
    assert one["rows"][0]["policies"][0]["seed"] == 1
    assert Path(one["rows"][0]["policies"][0]["file"]).name == "policy.zip"


CLASSIC = """
name = "stated"
env_id = "CartPole-v1"
control_period = 0.02
seeds = [0, 1]
episodes = 3
trainer = "sb3"
baselines = ["random"]
limit = false

[training]
total_steps = 512
n_envs = 4
n_steps = 32
batch_size = 64

[[train]]
integrator = "explicit_euler"
dt = 0.02

[[evaluate]]
integrator = ["explicit_euler", "symplectic_euler"]
dt = [0.02, 0.01]
"""


@pytest.mark.slow
def test_a_task_of_which_only_the_discretization_is_known_goes_from_training_to_the_page(
    tmp_path, capsys
):
    (tmp_path / "stated.toml").write_text(CLASSIC, encoding="utf-8")
    out = tmp_path / "out"
    assert main(["panel", str(tmp_path / "stated.toml"), "--out", str(out), *ALONE]) == 0
    panel = json.loads((out / "panel.json").read_text(encoding="utf-8"))
    names = ("explicit_euler", "symplectic_euler")
    cells = {f"gymnasium {name} dt={dt}" for name in names for dt in (0.02, 0.01)}
    assert {cell["name"] for cell in panel["cells"]} == cells
    capsys.readouterr()
    assert main(["evidence", "verify", str(out)]) == 0
    assert "outcomes, ledgers and labels follow" in capsys.readouterr().out
    unknown = EvidenceStore(out / "evidence").query(
        "SELECT count(solver_iterations_max) AS n, count(energy_start) AS e FROM records"
    )
    assert unknown.to_pylist() == [{"n": 0, "e": 0}]


PAGE = ROOT / "docs" / "how-to" / "adding.md"
BLOCKS = re.findall(r"^```python\n# (\w+\.py)\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S)
PLANTS = {
    "no gravity": lambda source: source,
    "neither gravity nor mass": lambda source: source.replace("mass:", "inertia:").replace(
        "self.mass,", "self.inertia,").replace("/ self.mass", "/ self.inertia").replace(
        "* self.mass *", "* self.inertia *"),
}  # fmt: skip
"""Changes of the page's plant."""


@pytest.fixture(params=PLANTS)
def settle(request, tmp_path, monkeypatch) -> str:
    """Id of the page's task on a plant that lacks something."""
    for name, source in BLOCKS:
        text = PLANTS[request.param](source) if name == "my_plant.py" else source
        (tmp_path / name).write_text(text, encoding="utf-8")
        monkeypatch.delitem(sys.modules, name.removesuffix(".py"), raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    making._load_testbed.cache_clear()
    lookup._own_class.cache_clear()
    yield "my_task:Settle-v0"
    gym.registry.pop("Settle-v0", None)
    for name, _ in BLOCKS:
        sys.modules.pop(name.removesuffix(".py"), None)


def test_there_is_no_hand_made_controller(settle):
    setup = environment_setup(settle, {})
    assert "gravity" not in setup.arguments()
    assert not has_handmade(setup)
    assert possible_baselines(setup) == ("random", "zero")
    with pytest.raises(ValueError, match="no hand-made controller for the task Settle, only for"):
        make_baseline("handmade", setup)


def _specification(env_id: str):
    evaluated = [{"integrator": "rk4", "dt": [0.05, 0.0125]}]
    own = {"duration": 0.5, "max_force": 2.0}
    changes = {"env_id": env_id, "environment": own, "evaluate": evaluated, "seeds": [0]}
    changes |= {"train": [{"integrator": "rk4", "dt": 0.05}], "family": [], "compare": []}
    changes["training"] = {"total_steps": 512, "n_steps": 64}
    data = small_data(**changes)
    del data["baselines"], data["perturbations"]
    return parse_spec(data, "test")


def test_a_specification_leaves_out_what_cannot_be(settle):
    spec = _specification(settle)
    check_spec(spec)
    assert spec.baselines == ("random", "zero")
    heavier = [p.changes for p in spec.variations if "mass" in p.changes]
    assert heavier == [{"mass": 1.2}] * ("mass" in environment_setup(settle, {}).arguments())
    assert sum("action_latency" in p.changes for p in spec.variations) == 1
