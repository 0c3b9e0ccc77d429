"""The hopper in engines that move rigid bodies: a springy leg, two controls, and the ground."""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass, replace
from itertools import islice
from typing import ClassVar

import numpy as np
import pytest
from engine_cases import EVERY, FIRST, TOLERANCE, assert_accelerations, lighter, needs, setup_of
from house import ROOT

import integ_gym  # noqa: F401
from integ_gym.envs.engines.maps import one_step_map
from integ_gym.envs.engines.stepping import make_engine
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.hopper import Hopper
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import ENGINES

HOPPER = "IntegHopper-v0"
CONTROL = (12.0, -150.0)
SPRINGLESS = {("mjx", "RK4"), ("newton", "mujoco_rk4")}
"""They evaluate forces four times, and have no springs at joints here."""
UNDAMPED = ("sapien",)
"""Whose solver does not take the leg's damping to float32's rounding."""
TAKES = [case for case in EVERY if case not in SPRINGLESS]


def _setup(engine, integrator, **given):
    damping = {"damping": 0.0} if engine in UNDAMPED else {}
    return setup_of(engine, integrator, HOPPER, dt=0.002, control_period=0.02, **damping, **given)


def _states(height):
    """(q, v) with the hip so high: fast turns of torso and leg, which is short and long."""
    rng = np.random.default_rng(5)
    for length in (0.3, 0.45, 0.5, 0.7):
        q = (rng.uniform(-2.0, 2.0), height, *rng.uniform(-0.6, 0.6, 2), length)
        yield tuple(map(float, q)), tuple(rng.uniform(-4.0, 4.0, 5).tolist())


def _errors(setup, height):
    """Largest error of one step from each state against the engine's map, over what is allowed.

    That is for 1 + |value| the tolerance of the other plants, or rounding times the condition of
    the mass matrix: up to 210, so that 32 bits leave 1e-5.
    """
    known, system = one_step_map(setup.engine.map), setup.system
    rounding = 2.0 ** -(53 if setup.engine.width == 64 else 24)
    for q, v in _states(height):
        end = known.step(SCALAR, system, q, v, system.no_losses, CONTROL, setup.timing.dt)
        motion = setup.engine.advance(SCALAR, q, v, ((CONTROL, 1),), None)
        expected, got = np.array((*end.q, *end.v)), np.array((*motion.q, *motion.v))
        condition = np.linalg.cond(np.array(setup.plant.mass_matrix(SCALAR, q)))
        allowed = max(TOLERANCE[setup.engine.width], rounding * condition)
        yield float((np.abs(got - expected) / (1.0 + np.abs(expected))).max()) / allowed


@pytest.mark.parametrize(("engine", "integrator"), lighter(TAKES))
def test_free_flight_is_the_map_that_an_engine_is_said_to_apply(engine, integrator):
    setup = _setup(engine, integrator)
    assert max(_errors(setup, 2.0)) <= 1.0


@pytest.mark.parametrize(
    ("engine", "integrator"),
    lighter([x for x in TAKES if ENGINES.load(x[0]).maps[x[1]].startswith("symplectic_euler")]),
)
def test_our_ground_is_the_maps_where_forces_are_evaluated_once(engine, integrator):
    """From a foot pressed in, that slides. MuJoCo's `implicit` knows none of its slopes."""
    setup = _setup(engine, integrator)
    pressed = max(_errors(setup, 0.25))
    if integrator.endswith("implicit"):
        assert pressed > 1e3
    else:
        assert pressed <= 10.0


@dataclass(frozen=True)
class FlyingHopper(Hopper):
    """The hopper where it never lands."""

    contacts: ClassVar[tuple] = ()
    contact_names: ClassVar[tuple[str, ...]] = ()


@pytest.mark.parametrize(
    ("engine", "integrator"),
    lighter([*FIRST, ("mujoco", "RK4"), ("drake", "radau3"), ("drake", "runge_kutta3")]),
)
def test_steps_at_once_are_single_ones_with_a_spring(engine, integrator):
    """A force that is held for a step is the spring's of that step."""
    needs(engine)
    plant = FlyingHopper(**({"damping": 0.0} if engine in UNDAMPED else {}))
    made = make_engine(engine, PlantSystem(plant), integrator, 0.002)
    (q, v), *_ = _states(2.0)
    at_once = made.advance(SCALAR, q, v, ((CONTROL, 5),), None)
    for _ in range(5):
        motion = made.advance(SCALAR, q, v, ((CONTROL, 1),), None)
        q, v = motion.q, motion.v
    tolerance = 1e-10 if made.width == 64 else 1e-4
    np.testing.assert_allclose((*at_once.q, *at_once.v), (*q, *v), rtol=0.0, atol=tolerance)


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_accelerations_before_a_step_are_the_plants(engine, integrator):
    """With the spring's force, whoever applies it, and the ground's."""
    setup = _setup(engine, integrator)
    assert_accelerations(setup, [*_states(2.0), *_states(0.25)], CONTROL)


@pytest.mark.parametrize(("engine", "integrator"), sorted(SPRINGLESS))
def test_a_spring_that_an_engine_has_not_in_all_stages_is_refused(engine, integrator):
    with pytest.raises(ValueError, match="springs at joints are not given to engine"):
        _setup(engine, integrator)


def test_damping_that_physx_does_not_resolve_is_refused():
    with pytest.raises(ValueError, match="is not the map"):
        setup_of("sapien", "tgs", HOPPER, dt=0.002, control_period=0.02)


@pytest.fixture
def grounds(monkeypatch):
    """`benchmarks/engine_contact.py`."""
    for engine in ("mujoco", "mjx", "mujoco_warp", "newton", "drake", "dart", "pybullet"):
        needs(engine)
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    yield importlib.import_module("engine_contact")
    for name in [x for x in sys.modules if x.partition(".")[0] in ("engine_contact", "measuring")]:
        del sys.modules[name]


def test_the_page_says_what_contact_by_engines_laws_comes_to(grounds):
    page = (ROOT / "docs" / "reference" / "environments.md").read_text(encoding="utf-8")
    for plant, (measure, _) in grounds.PLANTS.items():
        for engine, integrator in (("native", "symplectic_euler"), ("mujoco", "Euler")):
            found = [measure(engine, integrator, dt) for dt in grounds.STEPS]
            cells = " | ".join(grounds.row(f"{engine}/{integrator}", found))
            assert f"| {cells} |" in page, plant
    for name, values in grounds.closed_forms().items():
        assert f"| {' | '.join(grounds.row(f'closed form, {name}', [values]))} |" in page


def test_a_stiff_plane_of_ours_bounces_as_its_closed_form_says(grounds, monkeypatch):
    """The weight, which that leaves out, matters less the stiffer the plane is."""
    height, _, lost, _ = grounds.closed_forms()["ours"]
    gaps = []
    for stiffness in (1e4, 1e6, 1e8):
        monkeypatch.setattr(grounds, "BLOCK", replace(grounds.BLOCK, stiffness=stiffness))
        found = grounds.block("native", "reference", 0.0005)
        gaps.append((abs(found[0] - height), abs(found[2] - lost)))
    assert gaps[2][0] < 0.2 * gaps[1][0] < 0.04 * gaps[0][0]
    assert gaps[2] == pytest.approx((0.0, 0.0), abs=0.1)


BODIES = [("mujoco", "Euler"), ("mujoco", "RK4"), ("drake", "tamsi"), ("drake", "sap")]
BODIES += [("dart", "semi_implicit_euler"), ("pybullet", "semi_implicit_euler")]


@pytest.mark.parametrize(("engine", "integrator"), BODIES)
def test_what_lands_on_an_engines_ground_is_our_hopper(grounds, engine, integrator):
    """In the air by the engine's map, step after step; then it hops by a law of its own."""
    dt = grounds.STEPS[1]
    system = PlantSystem(FlyingHopper())
    known = one_step_map(ENGINES.load(engine).maps[integrator])
    (q, v), *_ = _states(2.0)
    for there in islice(grounds.HOPPERS[engine](integrator, dt, (q, v)), 50):
        end = known.step(SCALAR, system, q, v, system.no_losses, (0.0, 0.0), dt)
        q, v = end.q, end.v
        np.testing.assert_allclose((*there[0], *there[1]), (*q, *v), rtol=0.0, atol=1e-8)
    top, deep, lost, slipped = grounds.hopper(engine, integrator, dt)
    truth = grounds.hopper("native", "implicit_midpoint", grounds.STEPS[2])
    assert abs(top / truth[0] - 1.0) < 0.05
    assert 0.03 < abs(lost / truth[2] - 1.0) < 0.1
    assert 0.0 < deep < 0.99 * truth[1]
    assert 0.0 < slipped != pytest.approx(truth[3], rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["mjx", "mujoco_warp"])
@pytest.mark.parametrize("plant", ["block", "hopper"])
def test_engines_of_mujocos_family_land_as_it_does(grounds, engine, plant):
    measure, _ = grounds.PLANTS[plant]
    found, wanted = (measure(name, "Euler", grounds.STEPS[1]) for name in (engine, "mujoco"))
    np.testing.assert_allclose(found, wanted, rtol=1e-3, atol=1e-3)


GROUNDS = ["mujoco", pytest.param("newton", marks=pytest.mark.slow), "drake", "dart", "pybullet"]


@pytest.mark.parametrize("engine", GROUNDS)
def test_a_block_slides_as_coulomb_says_and_does_not_bounce_unasked(grounds, engine):
    bounced, deep, lost, slid = grounds.block(engine, grounds.SUBJECTS[engine][0], 0.001)
    _, _, energy, rigid = grounds.closed_forms()["rigid"]
    assert slid == pytest.approx(rigid, abs=1.0)
    assert bounced < 0.1
    assert 0.0 < deep < 10.0
    assert lost == pytest.approx(energy, rel=0.01)
