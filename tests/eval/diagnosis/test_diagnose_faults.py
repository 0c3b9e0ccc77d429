"""Planted faults: every kind of line of a diagnosis can say NO, and says it of the right thing."""

from __future__ import annotations

from dataclasses import replace

import mutants
import numpy as np
import planted
import pytest
from examining import RESTING, examine, verdicts
from plant_checks import damped

from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.integrators.rk4 import RK4
from integ_gym.envs.plants.contact import Stops
from integ_gym.envs.registries import PLANTS
from integ_gym.envs.settings import Timing
from integ_gym.envs.tasks import interface as _box
from integ_gym.eval.diagnosis import bench as run_open_loop
from integ_gym.eval.diagnosis import control, identity
from integ_gym.eval.diagnosis.subject import subjects


@pytest.mark.parametrize("name", RESTING)
def test_any_wrong_sign_or_number_in_a_plant_is_seen(name):
    owner, rest = PLANTS.load(name), subjects(None, name, [])[0].rest
    states = identity.states_around(rest)

    def is_seen(fault):
        plant = damped(fault)
        return not (
            identity.energy_defect(plant, states) < identity.EXACT
            and identity.mass_defect(plant, states) < identity.EXACT
            and abs(identity.rest_energy(plant, rest)) < identity.EXACT
            and (
                not hasattr(plant, "jacobian")
                or identity.jacobian_defect(plant, states) < identity.EXACT
            )
        )

    faults = [
        fault
        for method in ("acceleration", "energy", "dissipation", "jacobian", "mass_matrix")
        if hasattr(owner, method)
        for make in (mutants.sign_errors, mutants.wrong_numbers)
        for fault in make(owner, method)
    ]
    assert len(faults) > 5
    assert [fault.__name__ for fault in faults if not is_seen(fault)] == []


@pytest.mark.parametrize(
    ("name", "fragment"),
    [
        ("Unbooked", "rate of energy"),
        ("Lifted", "energy at rest"),
        ("Heavy", "mass matrix ×"),
        ("Wavering", "change of the mass matrix"),
        ("Blunt", "Jacobian"),
    ],
)
def test_a_plant_that_contradicts_itself(name, fragment, tmp_path):
    findings = examine("plant", f"planted:{name}", store=tmp_path / "none")
    assert verdicts(findings, fragment) == {False}
    others = [f for f in findings if fragment not in f.quantity]
    assert all(f.holds for f in others)


@pytest.fixture(scope="module")
def boasters(tmp_path_factory):
    """Section `integrator` on the pendulum, of integrators that are not what they say."""
    names = [f"planted:{n}" for n in ("Boaster", "Growing", "Nowhere", "WrongWeight", "Heun")]
    store = tmp_path_factory.mktemp("boasters")
    return examine("integrator", "pendulum", *names, "rk4", store=store)


@pytest.mark.parametrize(
    ("name", "order", "symplectic", "reversible"),
    [
        ("planted:Boaster", False, False, False),
        ("planted:Growing", True, False, True),
        ("planted:Nowhere", False, None, None),
        ("planted:WrongWeight", False, True, True),
        ("planted:Heun", True, True, True),
        ("rk4", True, True, True),
    ],
)
def test_claims_are_put_to_the_test(boasters, name, order, symplectic, reversible):
    assert verdicts(boasters, "order of convergence", name) == {order}
    assert verdicts(boasters, "symplectic, max", name) == {symplectic}
    assert verdicts(boasters, "reversible, forward", name) == {reversible}


def test_losses_that_are_not_booked_as_they_are_taken(tmp_path):
    names = ("planted:Forgetful", "mutants:RectangleLedger", "rk4")
    findings = examine("damping", "pendulum", *names, store=tmp_path)
    for name in names:
        for quantity in ("Σ |energy residual|", "energy booked as dissipated"):
            assert verdicts(findings, quantity, name) == {name == "rk4"}


def test_a_plant_that_books_no_damping(tmp_path):
    """Even of the reference: SciPy's integral does not ask the plant what it dissipates."""
    findings = examine("damping", "planted:Unbooked", "reference", store=tmp_path)
    assert verdicts(findings, "Σ |energy residual|") == {False}
    assert verdicts(findings, "energy booked as dissipated") == {False}


def test_friction_that_is_not_booked_or_does_not_hold_the_plant(tmp_path):
    names = ("planted:Forgetful", "rk4", "explicit_euler")
    findings = examine("friction", "pendulum", *names, store=tmp_path)
    for name in names[:2]:
        assert verdicts(findings, "dissipated", name) == {name == "rk4"}
        assert verdicts(findings, "smoothed friction, Σ", name) == {name == "rk4"}
        assert verdicts(findings, "largest speed", name) == {True}
    assert verdicts(findings, "largest speed", "explicit_euler") == {False}


def test_energy_that_grows_under_a_symplectic_name(tmp_path):
    findings = examine("free motion", "pendulum", "planted:Growing", "rk4", store=tmp_path)
    assert verdicts(findings, "energy change after", "planted:Growing") == {False}
    assert verdicts(findings, "energy change after", "rk4") == {True}


def test_a_method_that_pumps_where_it_should_drain(tmp_path, monkeypatch):
    """Explicit Euler in the place of RK4, whose energy decays."""
    monkeypatch.setattr(planted.Silent, "theory", RK4.theory, raising=False)
    findings = examine("free motion", "pendulum", "planted:Silent", store=tmp_path)
    assert verdicts(findings, "energy change after") == {False}
    findings = examine("stiffness", "pendulum", "planted:Silent", store=tmp_path / "other")
    assert verdicts(findings, "one step, linearized") == {False}


def test_a_solver_that_does_not_solve(tmp_path):
    findings = examine("free motion", "pendulum", "planted:Unsolved", store=tmp_path)
    assert verdicts(findings, "solver iterations") == {False}


def test_an_oscillation_that_grows_where_one_step_says_it_does_not(tmp_path, monkeypatch):
    monkeypatch.setattr("integ_gym.envs.numerics.stability_limit", lambda name: 2.5)
    findings = examine("stiffness", "pendulum", "symplectic_euler", store=tmp_path)
    assert verdicts(findings, "small oscillation, factor") == {False}


@pytest.mark.parametrize("plant", RESTING)
def test_slow_and_fast_growth_of_own_integrators_is_seen(plant, tmp_path):
    """Heun's method grows by (hω)⁴ / 8 per step alone."""
    findings = examine("stiffness", plant, "planted:Heun", "planted:Silent", store=tmp_path)
    assert verdicts(findings, "small oscillation, factor") == {True}


def test_commands_that_are_not_cut(tmp_path, monkeypatch):
    def uncut(self, ops, action):
        return command(self, ops, action)._replace(controls=action)

    command = run_open_loop.OpenLoop.command
    monkeypatch.setattr(run_open_loop.OpenLoop, "command", uncut)
    findings = examine("actuation", "pendulum", "rk4", store=tmp_path)
    assert verdicts(findings, "|control − command|") == {False}
    assert verdicts(findings, "IntegPendulum-v0, decisions") == {True}


def test_saturation_that_is_not_counted(tmp_path, monkeypatch):
    def uncounted(ops, action, limit):
        command = saturated(ops, action, limit)
        return command._replace(saturated=command.saturated & False)

    saturated = _box.saturate
    monkeypatch.setattr(_box, "saturate", uncounted)
    findings = examine("actuation", "pendulum", "rk4", store=tmp_path)
    assert verdicts(findings, "counted as saturated") == {False}
    assert verdicts(findings, "IntegPendulum-v0, decisions") == {False}


def test_work_that_is_booked_by_half(tmp_path, monkeypatch):
    def advance(self, *arguments):
        motion = whole(self, *arguments)
        return motion._replace(work=0.5 * motion.work)

    whole = NativeEngine.advance
    monkeypatch.setattr(NativeEngine, "advance", advance)
    findings = examine("actuation", "pendulum", "rk4", "reference", store=tmp_path)
    assert verdicts(findings, "work booked") == {False}
    assert verdicts(findings, "Σ |energy residual|") == {False}


@pytest.mark.parametrize("late", [0, 1, 2])
def test_commands_that_act_at_the_wrong_time(late, tmp_path, monkeypatch):
    """Latencies ignored, or one step too long wherever there is one."""

    def mistimed(cls, **given):
        timing = right(**given)
        return replace(timing, delay=divmod(_wrong(timing, late), timing.substeps))

    right = Timing.of
    if late != 1:
        monkeypatch.setattr(Timing, "of", classmethod(mistimed))
    monkeypatch.setattr(control, "success", lambda *arguments: None)
    findings = examine("latency", "pendulum", "rk4", store=tmp_path)
    assert verdicts(findings, "delayed commands") == {late == 1}


def _wrong(timing: Timing, late: int) -> int:
    return max(0, timing.latency - 1) if late == 0 else 0 if timing.latency < 2 else timing.latency


def test_motions_that_end_together_do_not_differ():
    a = np.array([[0.0, 1.0], [2.0, 3.0], [np.nan, np.nan]])
    assert control.different(a, a.copy(), 0.0) == 0
    assert control.different(a, np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]), 0.0) == 1
    assert control.different(a, np.full((3, 2), np.nan), 0.0) == 2


@pytest.fixture
def impacts(tmp_path, monkeypatch):
    """Section `contact` of the reference on the pendulum, with the stops' contact altered."""

    def run(**change):
        def contact(self, ops, q, v):
            true = whole(self, ops, q, v)
            return true._replace(**{k: f(getattr(true, k)) for k, f in change.items()})

        whole = Stops.contact
        monkeypatch.setattr(Stops, "contact", contact)
        return examine("contact", "pendulum", "reference", store=tmp_path)

    return run


@pytest.mark.parametrize(
    ("changed", "rebound", "penetration", "ledger"),
    [
        ({}, True, True, True),
        ({"force": lambda x: 0.8 * x}, False, False, False),
        ({"dissipated": lambda x: 0.0 * x}, True, True, False),
        ({"penetration": lambda x: 1.1 * x}, True, False, True),
    ],
)
def test_stops_that_are_wrong(impacts, changed, rebound, penetration, ledger):
    findings = impacts(**changed)
    assert verdicts(findings, "largest penetration") == {penetration}
    assert verdicts(findings, "Σ |energy residual|") == {ledger}
    if "force" not in changed:
        assert verdicts(findings, "share of energy left") == {rebound}


def test_an_impact_that_an_explicit_method_should_not_survive(tmp_path, monkeypatch):
    """Implicit Euler in the place of RK4: nothing is gained where something should be."""
    passive = replace(RK4.theory, passive=True)
    monkeypatch.setattr(planted.Heun, "theory", passive, raising=False)
    findings = examine("contact", "pendulum", "planted:Heun", store=tmp_path)
    assert verdicts(findings, "gains energy") == {False}


@pytest.mark.parametrize(
    ("section", "success"),
    [
        ("timestep refinement", {"reference": 1.0, "rk4": 1.0, "implicit_euler": 0.0}),
        ("latency", {"reference": 1.0, "rk4": 1.0, "implicit_euler": 0.0}),
        ("latency", {"reference": 0.0, "rk4": 0.0, "implicit_euler": 0.0}),
    ],
)
def test_success_that_differs_from_the_truth(section, success, tmp_path, monkeypatch):
    """Where nobody succeeds nothing is expected."""
    monkeypatch.setattr(control, "success", lambda diagnosis, env_id, name, *rest: success[name])
    findings = examine(section, "pendulum", "rk4", "implicit_euler", store=tmp_path)
    expected = (True, False) if success["reference"] else (None, None)
    for name, holds in zip(("rk4", "implicit_euler"), expected, strict=True):
        assert verdicts(findings, "hand-made controller", name) == {holds}


def test_a_task_without_a_controller_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(control, "has_handmade", lambda setup: False)
    findings = examine("latency", "pendulum", "rk4", store=tmp_path)
    assert {f.quantity.split()[0] for f in findings} == {"instants"}
