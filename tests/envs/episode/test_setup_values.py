"""A setup with other values of its parts is the same setup in everything else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from engine_cases import STOPPED, lighter, needs

import integ_gym  # noqa: F401
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.functional import params_of, setup_with_params
from integ_gym.envs.lanes import setup_of_lanes
from integ_gym.envs.registries import ENGINES

SWING_UP = "IntegCartPoleSwingUp-v0"


def _stopped(engine, integrator):
    return environment_setup(
        SWING_UP, {"engine": engine, "integrator": integrator, "dt": 0.001, "contact": "engine"}
    )


def _with_values(setup):
    plant = replace(setup.plant, cart_mass=2.0)
    return setup.with_values(plant, setup.task, setup.timing, 5.0)


PATHS = {
    "with_values": _with_values,
    "of_lanes": lambda setup: setup_of_lanes(setup, np.arange(2)),
    "traced_setup": lambda setup: setup_with_params(setup, params_of(setup, "float64")),
}


@pytest.mark.parametrize(
    ("engine", "integrator", "path"),
    lighter(
        [
            (engine, integrator, path)
            for engine, integrator in dict(reversed(STOPPED)).items()
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
