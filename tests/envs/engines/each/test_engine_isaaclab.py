"""Isaac Lab's engine, from a recorded exchange with its own environment, and without one."""

import gc

import gymnasium as gym
import numpy as np
import pytest
from apart_scenarios import SCENARIOS
from engine_cases import RECORDED_IDS, TOLERANCE
from engine_checks import new_setup
from exchanges import replayed

from integ_gym.cli import main
from integ_gym.envs.engines import isaaclab
from integ_gym.envs.engines.isaaclab import LEAST_INERTIA, usd
from integ_gym.envs.engines.stepping import missing_modules
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.registries import ENGINES

MAPS = ENGINES.load("isaaclab").maps
RECORDED = "isaaclab_engine"


@pytest.fixture(autouse=True)
def _no_idle_process():
    yield
    gc.collect()
    while isaaclab._idle:
        isaaclab._idle.pop().close()


@pytest.mark.slow
def test_every_integrator_is_the_map_that_it_is_said_to_be():
    """Of both plants, damped and undamped, in what Isaac Lab answered when it was recorded."""
    with replayed(RECORDED):
        found = SCENARIOS[RECORDED]()
    assert len(found) == len(MAPS) * len(RECORDED_IDS) * 2
    assert max(found.values()) <= TOLERANCE[32]


def test_a_model_that_is_not_the_plant_is_refused(monkeypatch):
    """Where the solver tells another mass than the plant's."""
    real = isaaclab.IsaaclabEngine.at_rest

    def heavier(engine, q):
        mass, force = real(engine, q)
        return 1.01 * mass, force

    monkeypatch.setattr(isaaclab.IsaaclabEngine, "at_rest", heavier)
    with replayed(RECORDED), pytest.raises(ValueError, match="another mass matrix"):
        new_setup("isaaclab", "euler", "IntegCartPole-v0")


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
