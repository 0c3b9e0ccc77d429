"""Driven, damped motion: convergence to the reference, and the energy ledger."""

import re
from math import pi
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from checks import ROD, solved
from motions import DRIVEN_PLANTS, STARTS, UNLIMITED
from stated import check_table

import integ_gym
from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.numerics.energy import ledger
from integ_gym.envs.ops.ops import SCALAR, join_state
from integ_gym.envs.plants.interface import controls_of
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import PLANTS

PERIOD = 0.05
CONTROLS = np.random.default_rng(3).uniform(-2.0, 2.0, 200)


@pytest.mark.parametrize("plant", DRIVEN_PLANTS)
def test_reference_agrees_with_dop853(plant):
    """Over a control period, whole or in parts: state, work and dissipation, up to fast spins."""
    for spin in (0.0, 12.0, 60.0, 200.0):
        state = np.array(join_state(*STARTS[plant]))
        state[-1] += spin
        truth, terms = solved(DRIVEN_PLANTS[plant], state, PERIOD, 1.7)
        for parts in (1, 4):
            found = ledger("reference", DRIVEN_PLANTS[plant], state, [1.7], PERIOD, parts)
            assert np.abs(found.state - truth).max() < 1e-10
            assert np.abs(np.array([found.work_j, found.losses_j]) - terms).max() < 1e-10


class Counting(PlantSystem):
    """Counts evaluations of the equations of motion."""

    evaluations = 0

    def rates(self, *arguments):
        self.evaluations += 1
        return super().rates(*arguments)


STAGES, KINKS = 12, 2
"""Evaluations of one inner step of the reference: those of its method, and at its ends for kinks of
contact points."""


COSTS = re.findall(
    r"^\| `(\w+)`, q = \((.*?)\), v = \((.*?)\) \| (\S+) s \| (\d+) \| (\d+) \|",
    (Path(__file__).parents[3] / "docs" / "explanation" / "verification.md").read_text(
        encoding="utf-8"
    ),
    re.MULTILINE,
)


def test_inner_steps_of_the_reference_are_as_stated():
    """The table of docs/explanation/verification.md: control periods of the environments' own."""
    place = "the table of docs/explanation/verification.md, as benchmarks/reference_cost.py has it,"
    check_table({plant for plant, *_ in COSTS}, PLANTS.names(), place)
    for plant, q, v, period, inner, evaluations in COSTS:
        system = Counting(PLANTS.load(plant)())
        engine = NativeEngine(system, "reference", float(period))
        q, v = (tuple(float(x) for x in values.split(",")) for values in (q, v))
        motion = engine.advance(SCALAR, q, v, ((controls_of(system.plant, 0.5), 1),), None)
        assert motion.iterations == int(inner)
        each = STAGES + KINKS * bool(system.contacts)
        assert system.evaluations == int(evaluations) == each * int(inner)


@pytest.mark.filterwarnings("ignore:.*the episode has terminated")  # its motion goes on
@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_reference_residual_with_damping_drive_and_fast_spin(env_id):
    limits = UNLIMITED.get(env_id, {})
    env = gym.make(env_id, integrator="reference", dt=0.05, damping=0.05, **limits).unwrapped
    env.action_space.seed(1)
    env.reset(seed=1)
    state = env.state if env_id == "IntegHopper-v0" else np.zeros_like(env.state)
    state[-3 if env_id == "IntegHopper-v0" else -1] = 60.0
    env.reset(options={"state": state})
    for _ in range(50):
        *_, info = env.step(env.action_space.sample())
        assert abs(info["energy_residual"]) < 1e-9
        assert info["solver_status"] == "ok"
    assert info["energy"] > 0.0


def test_ledger_terms_agree_with_an_independent_integral():
    """Work and dissipation in `info` over 200 control periods against `solve_ivp`, in each."""
    env = gym.make(
        "IntegPendulum-v0", integrator="rk4", dt=0.0125, control_period=PERIOD, damping=0.4,
        duration=11.0,
    )  # fmt: skip
    plant = env.unwrapped.setup.plant
    env.reset(options={"state": (pi - 1.0, 4.0)})
    for torque in CONTROLS:
        before = env.unwrapped.state
        *_, info = env.step(np.array([torque]))
        _, (work, dissipated) = solved(plant, before, PERIOD, float(torque))
        assert info["actuator_work"] == pytest.approx(work, abs=1e-6)
        assert info["dissipated"] == pytest.approx(dissipated, abs=1e-6)
        assert abs(info["energy_residual"]) < 1e-6


@pytest.mark.parametrize("integrator", ["rk4", "symplectic_euler", "reference"])
def test_speed_limit_is_booked(integrator):
    """With a limit on the speed the ledger closes as well as without it, and only with its term."""
    start, limit = (pi - 0.5, 0.0), 2.0
    controls = np.full(100, 2.0)
    free = ledger(integrator, ROD, start, controls, PERIOD, 16)
    clipped = ledger(integrator, ROD, start, controls, PERIOD, 16, max_speed=limit)
    assert free.clip_loss_j == 0.0
    assert clipped.clip_loss_j > 1.0
    assert abs(clipped.state[1]) <= limit
    assert clipped.total_residual_j < 1.5 * free.total_residual_j + 1e-9
    unexplained = clipped.energy_change_j - clipped.work_j + clipped.losses_j
    assert unexplained == pytest.approx(-clipped.clip_loss_j, abs=clipped.total_residual_j + 1e-9)
