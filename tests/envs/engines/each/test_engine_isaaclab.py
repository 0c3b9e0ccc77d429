"""Isaac Lab's engine, from a recorded exchange with its own environment, and without one."""

from __future__ import annotations

import gc

import gymnasium as gym
import numpy as np
import pytest
from apart_scenarios import SCENARIOS
from engine_cases import DAMPING, IDS, TOLERANCE, mapped, one_step, states
from engine_checks import new_setup
from exchanges import replayed

from integ_gym.cli import main
from integ_gym.envs.engines import isaaclab
from integ_gym.envs.engines.isaaclab import LEAST_INERTIA, usd
from integ_gym.envs.engines.maps import one_step_map
from integ_gym.envs.engines.stepping import missing_modules
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.registries import ENGINES
from integ_gym.support.isolated import WorkerError

MAPS = ENGINES.load("isaaclab").maps
RECORDED = "isaaclab_engine"


@pytest.fixture(autouse=True)
def _no_idle_process():
    yield
    gc.collect()
    while isaaclab._idle:
        isaaclab._idle.pop().close()


@pytest.fixture
def setup():
    """A cart-pole on Isaac Lab, as recorded."""
    with replayed(RECORDED):
        yield new_setup("isaaclab", "euler", "IntegCartPole-v0")


def test_every_integrator_is_the_map_that_it_is_said_to_be():
    """Of both plants, damped and undamped, in what Isaac Lab answered when it was recorded."""
    with replayed(RECORDED):
        found = SCENARIOS[RECORDED]()
    assert len(found) == len(MAPS) * len(IDS) * 2
    assert max(found.values()) <= TOLERANCE[32]


@pytest.mark.parametrize("integrator", MAPS)
def test_no_other_kind_of_symplectic_euler_would_do(integrator):
    """With damping, where it is taken otherwise, or in a cart-pole's Coriolis forces."""
    kinds = {"symplectic_euler", "symplectic_euler_implicit_damping"} - {MAPS[integrator]}
    with replayed(RECORDED):
        setup = new_setup("isaaclab", integrator, IDS[1], **DAMPING[IDS[1]])
        ends = [one_step(setup, *case) for case in states(setup, 8)]
        for name in kinds:
            known = one_step_map(name)
            expected = [mapped(known, setup, *case) for case in states(setup, 8)]
            assert np.abs(np.array(ends) - expected).max() > 1e-4


def test_a_model_that_is_not_the_plant_is_refused(monkeypatch):
    """Where the solver tells another mass than the plant's."""
    real = isaaclab.IsaaclabEngine.at_rest

    def heavier(engine, q):
        mass, force = real(engine, q)
        return 1.01 * mass, force

    monkeypatch.setattr(isaaclab.IsaaclabEngine, "at_rest", heavier)
    with replayed(RECORDED), pytest.raises(ValueError, match="another mass matrix"):
        new_setup("isaaclab", "euler", "IntegCartPole-v0")


def test_a_process_that_is_lost_is_an_error_and_no_motion(setup):
    """A crash says so at every further step, and its process is not used again."""
    engine = setup.engine
    engine._worker._process.kill()
    for _ in range(2):
        with pytest.raises(WorkerError, match="isaaclab ended with exit code -9"):
            one_step(setup, *states(setup, 1)[0])
    isaaclab._give_back(engine._worker)
    assert engine._worker not in isaaclab._idle


def test_without_its_environment_one_sentence_says_what_sets_it_up(capsys, tmp_path):
    assert missing_modules("isaaclab") == ["isaaclab"]
    with pytest.raises(ModuleNotFoundError, match="run: make isaaclab ") as told:
        gym.make("IntegPendulum-v0", engine="isaaclab", integrator="euler")
    assert "\n" not in str(told.value)
    assert main(["engines", "--engine", "isaaclab"]) == 0
    assert "isaaclab: not installed (isaaclab); run: make isaaclab" in capsys.readouterr().out
    given = ["--published", "planted_library:PlantedLibrary", "--out", str(tmp_path)]
    assert main(["census", "--engine", "isaaclab", *given]) == 0
    assert "make isaaclab" in capsys.readouterr().out


def test_a_mechanism_is_told_without_loss():
    """Damping of a hinge per degree, as Newton reads it; no body so light that it is changed."""
    text = usd(CartPole(damping=0.5, cart_damping=0.25).mechanism)
    assert f"newton:damping = {0.5 * np.pi / 180.0!r}" in text
    assert "newton:damping = 0.25" in text
    light = usd(Pendulum(mass_distribution="point", mass=1e-6).mechanism)
    assert f"diagonalInertia = ({LEAST_INERTIA!r}, " in light
    assert text.count("{") == text.count("}")
