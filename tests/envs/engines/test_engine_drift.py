"""The worked example of docs/explanation/drift.md, by all engines' integrators that are in it."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from engine_cases import CASES, FOREIGN, lighter, needs

from integ_gym.envs.engines.stepping import PlantSystem
from integ_gym.envs.numerics.stepping import engine_of
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.registries import ENGINES

POINT = Pendulum(gravity=9.81, mass_distribution="point")

SYMPLECTIC = (-0.797, 8.337, 1e-3)
DRIFTS = {
    "explicit_euler": (35850.0, 36700.0, 2e-3),
    "symplectic_euler": SYMPLECTIC,
    "symplectic_euler_implicit_damping": SYMPLECTIC,
    "symplectic_euler_implicit_velocity": SYMPLECTIC,
    "rk4": (-0.0741, 0.0741, 1e-3),
    "implicit_midpoint": (4.9e-5, 0.0124, 1e-2),
    "implicit_euler": (-100.0, 100.0, 1e-3),
    "reference": (0.0, 0.0, 0.0),
}
"""Map to the drift of energy at the end, its largest magnitude, both in percent, and the relative
tolerance of the figures."""

ARITHMETIC = {64: 1e-8, 32: 0.01}
"""Percent of energy that an engine's arithmetic may cost over the motion."""

ADAPTIVE = 2e-5
"""The same of an integrator that keeps to a tolerance: 1e-12 times 50 inner steps times 4000."""

MEASURED = [
    (engine, integrator)
    for engine, integrator, env_id in CASES
    if env_id == "IntegPendulum-v0" and ENGINES.load(engine).maps[integrator] in DRIFTS
]


def test_every_engine_is_measured():
    assert {engine for engine, _ in MEASURED} == set(FOREIGN)


@pytest.mark.parametrize(("engine", "integrator"), lighter(MEASURED))
def test_a_free_pendulum_drifts_as_the_map_does(engine, integrator):
    """A point mass released 0.5 rad from hanging, 4000 steps of 0.05 s: no hidden damping."""
    needs(engine)
    made = engine_of(f"{engine}/{integrator}", PlantSystem(POINT), 0.05)
    q, v = (pi - 0.5,), (0.0,)
    energies = [POINT.energy(SCALAR, q, v)]
    for _ in range(4000):
        motion = made.advance(SCALAR, q, v, ((0.0, 1),), None)
        q, v = motion.q, motion.v
        energies.append(POINT.energy(SCALAR, q, v))
    drift = 100.0 * (np.array(energies) / energies[0] - 1.0)
    end, largest, relative = DRIFTS[made.map]
    spare = ADAPTIVE if made.map == "reference" else ARITHMETIC[made.width]
    assert drift[-1] == pytest.approx(end, rel=relative, abs=spare)
    assert np.abs(drift).max() == pytest.approx(largest, rel=relative, abs=spare)
