"""Sweeps: every value but the undisturbed one is a change of home and truth."""

from __future__ import annotations

import pytest
from small_panel import small_data

from integ_gym.eval.panel.cells import SpecError
from integ_gym.eval.panel.spec import parse_spec

LATENCY = {"argument": "action_latency", "values": [0.1, 0.0, 0.05]}


def _spec(*sweeps, **changes):
    return parse_spec(small_data(sweep=list(sweeps), perturbations=[], **changes), "test")


def test_values_are_changes_and_the_undisturbed_one_is_there_already():
    spec = _spec(LATENCY, {"argument": "mass", "values": [0.8, 1.2]})
    assert [(s.argument, s.values, s.unit) for s in spec.sweeps] == [
        ("action_latency", (0.0, 0.05, 0.1), "s"), ("mass", (0.8, 1.2), "kg"),
    ]  # fmt: skip
    names = ["action_latency=0.05", "action_latency=0.1", "mass=0.8", "mass=1.2"]
    assert [p.name for p in spec.changes] == names
    cells = [cell.name for cell in spec.cells_of(spec.train[0]) if cell.kind == "perturbation"]
    assert cells == [
        f"{place} dt=0.05, {name}" for name in names for place in ("explicit_euler", "reference")
    ]
    assert "No action latency is evaluated." not in spec.gaps()


def test_a_panel_without_sweeps_says_nothing_of_them():
    assert "sweeps" not in _spec().to_json()
    assert list(_spec(LATENCY).to_json()["sweeps"][0]["values"]) == [0.0, 0.05, 0.1]


@pytest.mark.parametrize(
    ("sweep", "message"),
    [
        ({"argument": "dt", "values": [0.1, 0.2]}, "which is what cells vary; use `evaluate`"),
        ({"argument": "masss", "values": [1, 2]}, "Did you mean 'mass'"),
        ({"argument": "fallback", "values": [1, 2]}, "unknown argument in `sweep`"),
        ({"argument": "mass", "values": [1.0]}, "sweep.0..values"),
        ({"argument": "mass", "values": [1.0, "2"]}, "sweep.0..values"),
        ({"argument": "mass", "values": [1.0, 1.0]}, "twice"),
        ({"argument": "mass", "value": [1.0, 2.0]}, "unknown field `value` - at `sweep"),
        ({"argument": "mass"}, "missing required field `values`"),
        ("mass", "Expected `table`, got `str`"),
        ({"argument": "action_latency", "values": [0.0, 0.03]}, "whole multiple"),
    ],
)
def test_what_cannot_be_swept_is_refused(sweep, message):
    with pytest.raises(SpecError, match=message):
        _spec(sweep)


def test_of_another_librarys_environment_what_is_stated_is_swept():
    own = {
        "env_id": "Pendulum-v1", "family": [], "compare": [], "baselines": ["random"],
        "train": [{"integrator": "symplectic_euler", "dt": 0.05}],
        "evaluate": [{"integrator": "symplectic_euler", "dt": 0.05}],
    }  # fmt: skip
    gravity = {"argument": "g", "values": [8.0, 10.0]}
    with pytest.raises(SpecError, match=r"`g`, whose number .* under `environment`"):
        _spec(gravity, environment={}, **own)
    spec = _spec(gravity, environment={"g": 10.0}, **own)
    assert [change.environment for change in spec.changes] == [{"g": 8.0}]


def test_an_argument_is_swept_once():
    with pytest.raises(SpecError, match="`sweep` lists something twice"):
        _spec(LATENCY, LATENCY)
