"""A setup with other values of its parts is the same setup in everything else."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import STOPPED, lighter, needs

import integ_gym  # noqa: F401
from integ_gym.envs.catalogue.lookup import environment_setup
from integ_gym.envs.functional import params_of, traced_setup
from integ_gym.envs.lanes import of_lanes
from integ_gym.envs.registries import ENGINES
from integ_gym.eval.diagnosis.bench import count_evaluations

SWING_UP = "IntegCartPoleSwingUp-v0"
ONE_OF_EACH = list(dict(reversed(STOPPED)).items())
"""Of every engine with stops of its own, its first integrator that heeds them."""


def _stopped(engine, integrator):
    return environment_setup(
        SWING_UP, {"engine": engine, "integrator": integrator, "dt": 0.001, "contact": "engine"}
    )


def _with_values(setup):
    plant = replace(setup.plant, cart_mass=2.0)
    return setup.with_values(plant, setup.task, setup.timing, 5.0)


PATHS = {
    "with_values": _with_values,
    "of_lanes": lambda setup: of_lanes(setup, np.arange(2)),
    "traced_setup": lambda setup: traced_setup(setup, params_of(setup, "float64")),
}


@pytest.mark.parametrize(
    ("engine", "integrator", "path"),
    lighter(
        [
            (engine, integrator, path)
            for engine, integrator in ONE_OF_EACH
            for path in PATHS
            if path != "traced_setup" or ENGINES.load(engine).batched
        ]
    ),
)
def test_stops_of_the_engines_own_are_kept(engine, integrator, path):
    needs(engine)
    setup = _stopped(engine, integrator)
    made = PATHS[path](setup)
    assert made.system.stops is None
    assert made.system.engine_stops == made.plant.stops
    assert made.engine.system.engine_stops == made.plant.stops
    assert type(made.engine) is type(setup.engine)


@pytest.mark.parametrize("path", PATHS)
def test_our_own_stops_stay_ours(path):
    made = PATHS[path](environment_setup(SWING_UP, {}))
    assert made.system.engine_stops is None
    assert made.system.stops == made.plant.stops


def test_values_are_those_given():
    setup = environment_setup(SWING_UP, {"dt": 0.01})
    timing = replace(setup.timing, dt=0.005, substeps=2)
    plant = replace(setup.plant, cart_mass=2.0)
    made = setup.with_values(plant, setup.task, timing, 5.0)
    assert made.plant.cart_mass == made.engine.system.plant.cart_mass == 2.0
    assert (made.engine.dt, made.timing.substeps) == (0.005, 2)
    assert made.system.max_speed == 5.0
    assert (made.settings, made.task) == (setup.settings, setup.task)


def test_counting_keeps_the_stops_of_its_setup():
    """The native engine has no stops of its own: what is counted is not another system."""
    env = gym.make(SWING_UP).unwrapped
    env.setup = replace(env.setup, system=_stopped("mujoco", "Euler").system)
    with pytest.raises(ValueError, match="no joint stops"):
        count_evaluations(env)
