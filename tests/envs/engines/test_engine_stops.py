"""Stops in every engine: ours, as a generalized force, and the engine's own."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import (
    COMPILING,
    EVERY,
    FIRST,
    STOPPED,
    TOLERANCE,
    lighter,
    mapped,
    needs,
    one_step,
    setup_of,
    solved,
)
from engine_checks import new_setup

import integ_gym  # noqa: F401
from integ_gym.envs.engines.maps import one_step_map
from integ_gym.envs.engines.newton import FEATHERSTONE
from integ_gym.envs.engines.rigid import HeldForce
from integ_gym.envs.functional import params_of, setup_with_params
from integ_gym.envs.lanes import setup_of_lanes
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import ENGINES

SWING_UP = "IntegCartPoleSwingUp-v0"


def _few(cases):
    """Of engines that compile, the first integrator that is among the cases."""
    first = dict(reversed(cases))
    return [case for case in cases if case[0] not in COMPILING or case[1] == first[case[0]]]


@pytest.mark.parametrize(("engine", "integrator"), lighter(FIRST))
def test_our_stops_act_in_every_engine(engine, integrator):
    """A cart that runs into the stop is pushed back, with the depth, force and loss on record."""
    needs(engine)
    env = gym.make(
        "IntegCartPoleSwingUp-v0", engine=engine, integrator=integrator, dt=0.001,
        control_period=0.02,
    )  # fmt: skip
    env.reset(seed=0, options={"state": (2.35, 2.0, np.pi, 0.0)})
    told = [env.step(np.zeros(1, np.float32))[4] for _ in range(12)]
    assert env.unwrapped.state[1] < 0.0
    assert max(info["penetration"] for info in told) == pytest.approx(0.036, abs=0.004)
    assert min(info["contact_force"] for info in told) < -80.0
    assert sum(info["contact_loss"] for info in told) == pytest.approx(1.2, abs=0.2)
    assert abs(sum(info["energy_residual"] for info in told)) < 0.05


SOLVERS = {
    "mujoco": (1e-8, 100),
    "mujoco_warp": (1e-6, 100),
    "newton": (1e-6, 100),
    "pybullet": (1e-7, 50),
}
"""Tolerance and cap of the constraint solvers that tell of themselves."""


@pytest.mark.parametrize(("engine", "integrator"), lighter(_few(STOPPED)))
def test_stops_of_the_engines_own_leave_the_ledger_open_and_tell_of_their_solver(
    engine, integrator
):
    """In single and in vector environments."""
    needs(engine)
    given = {
        "id": SWING_UP, "engine": engine, "integrator": integrator, "dt": 0.001,
        "control_period": 0.02, "contact": "engine",
    }  # fmt: skip
    start = (2.35, 2.0, np.pi, 0.0)
    single, many = gym.make(**given), gym.make_vec(**given, num_envs=2)
    single.reset(seed=0, options={"state": start})
    many.reset(seed=0, options={"state": np.array([start] * 2)})
    told = [single.step(np.zeros(1, np.float32))[4] for _ in range(12)]
    for one in told[:4]:
        both = many.step(np.zeros((2, 1), np.float32))[4]
        for name in ("solver_iterations", "solver_residual", "solver_status"):
            assert (both[name] == one[name]).all()
    touched = [info for info in told if info["contact_force"]]
    free = [info for info in told if not info["contact_force"]]
    assert touched
    assert all(np.isnan([i["energy_residual"], i["contact_loss"]]).all() for i in touched)
    assert all(abs(info["energy_residual"]) < 1e-2 for info in free)
    assert single.unwrapped.state[0] < 2.4 + 0.02
    made = single.unwrapped.setup.engine
    assert made.describe()["stops"]
    solver = None if integrator == FEATHERSTONE else SOLVERS.get(engine)
    if solver is None:
        assert {info["solver_status"] for info in told} == {"not_reported"}
        assert not any(info["solver_iterations"] for info in told)
        assert made.solver()["solver_cap"] is None
    else:
        tolerance, cap = solver
        assert {info["solver_status"] for info in told} == {"ok"}
        assert all(0 < info["solver_iterations"] < cap for info in touched)
        assert made.solver() == {"solver_tolerance": pytest.approx(tolerance), "solver_cap": cap}


def _told(motion):
    """All that a step tells, as numbers."""
    reported = (motion.iterations, motion.residual, motion.converged, motion.contact_force)
    return [float(x) for x in (*motion.q, *motion.v, *motion.losses, *reported)]


@pytest.mark.parametrize(("engine", "integrator"), lighter(_few(STOPPED)))
def test_a_step_against_the_stop_depends_on_nothing_that_went_before(engine, integrator):
    """To the last bit, in any order, and after motions that diverge."""
    needs(engine)
    given = {"dt": 0.001, "contact": "engine"}
    cases = [((x, 0.3), (1.0, 5.0), 2.0) for x in (2.41, 0.0, 2.5, -2.45, 2.4)]
    violent = ((2.6, 0.3), (1e5, -1e5), 0.0)

    def told(setup, case):
        q, v, control = case
        return _told(setup.engine.advance(SCALAR, q, v, (((control,), 1),), None))

    first = new_setup(engine, integrator, SWING_UP, **given)
    expected = [told(first, case) for case in cases]
    other = new_setup(engine, integrator, SWING_UP, **given)
    for k in np.random.default_rng(2).integers(0, len(cases), 20):
        told(other, violent)
        if engine != "pybullet":  # whose stops are lost for good where a state is not a number
            other.engine.run(1)(*[np.nan] * 6)
        np.testing.assert_array_equal(told(other, cases[k]), expected[k])


def _held(setup, name, q, v, control):
    """(q, v) after one step of a map, with the force of stops and friction held during it."""
    system = setup.system
    resisting, _ = system.resistance(SCALAR, q, v)
    drive = system.to_generalized_force((control,))
    force = tuple(a + b for a, b in zip(drive, resisting, strict=True))
    held = HeldForce(system.plant, force)
    end = one_step_map(name).step(SCALAR, held, q, v, (0.0,), (control,), setup.timing.dt)
    return np.array((*end.q, *end.v))


def _against_the_stop():
    """(q, v, control) at random with the cart in either stop, where it stays for some steps."""
    rng = np.random.default_rng(5)
    return [
        (
            (side * (2.42 + 0.02 * rng.random()), float(rng.uniform(-3.0, 3.0))),
            (float(rng.uniform(-1.0, 1.0)), float(rng.uniform(-6.0, 6.0))),
            float(rng.uniform(-3.0, 3.0)) * (place > 3),
        )
        for place in range(12)
        for side in (1.0, -1.0)
    ]


@pytest.mark.parametrize(("engine", "integrator"), lighter(_few(EVERY)))
def test_a_step_in_contact_is_what_the_engine_says(engine, integrator):
    """Of its map, with the force of stops and friction held over the step or within the stages."""
    setup = setup_of(engine, integrator, SWING_UP, dt=0.004, cart_friction=0.5)
    told, cases = setup.engine.describe(), solved(setup, _against_the_stop())
    assert len(cases) >= 20
    assert told["resistance"] == {
        True: "held over the step", False: "within the integrator's stages",
    }[engine not in ("casadi", "pinocchio")]  # fmt: skip
    for case in cases:
        if told["resistance"] == "held over the step":
            expected = _held(setup, told["map"], *case)
        else:
            expected = mapped(one_step_map(told["map"]), setup, *case)
        error = np.abs(one_step(setup, *case) - expected) / (1.0 + np.abs(expected))
        assert error.max() <= TOLERANCE[setup.engine.width]


@pytest.mark.parametrize(("engine", "integrator"), lighter([("mujoco", "Euler"), ("mjx", "Euler")]))
def test_a_setup_with_other_values_keeps_the_stops_of_the_engines_own(engine, integrator):
    setup = new_setup(engine, integrator, SWING_UP, dt=0.001, contact="engine")
    heavier = replace(setup.plant, cart_mass=2.0)
    made = [
        setup.with_values(heavier, setup.task, setup.timing, 5.0),
        setup_of_lanes(setup, np.arange(2)),
    ]
    if ENGINES.load(engine).batched:
        made.append(setup_with_params(setup, params_of(setup, "float64")))
    for other in made:
        assert other.system.stops is None
        assert other.system.engine_stops == other.plant.stops
        assert other.engine.system.engine_stops == other.plant.stops
        assert type(other.engine) is type(setup.engine)
