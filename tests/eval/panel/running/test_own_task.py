"""docs/how-to/adding.md's task made part of the suite: what its plant lacks, panels leave out."""

from __future__ import annotations

import re
import sys

import gymnasium as gym
import pytest
from house import ROOT
from small_panel import small_data

from integ_gym.envs import environment as lookup
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.testbeds import making
from integ_gym.eval.panel.run import check_spec
from integ_gym.eval.panel.spec import parse_spec
from integ_gym.train.baselines import has_handmade, make_baseline, possible_baselines

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


@pytest.mark.parametrize(
    ("env_id", "message"),
    [
        ("my_task:Settles-v0", "registers no environment 'Settles-v0'; call gymnasium.register"),
        ("no_task:Settle-v0", "cannot import 'no_task' of .*ModuleNotFoundError.*PYTHONPATH"),
        ("Settle-v0", 'your own as "module:Id-v0", or a testbed of your own as "module:Class"'),
    ],
)
def test_an_id_that_is_unknown_is_told_how_to_bring_ones_own(settle, env_id, message):
    with pytest.raises(ValueError, match=message):
        check_spec(_specification(env_id))
