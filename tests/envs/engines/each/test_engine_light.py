"""Light plants: an engine that wants moments of inertia above zero changes nothing or refuses."""

from __future__ import annotations

import pytest
from engine_cases import FIRST, TOLERANCE, lighter, needs, setup_of, states
from engine_checks import defect, new_setup

from integ_gym.envs.registries import ENGINES

PENDULUM = "IntegPendulum-v0"
FLOORED = ("mujoco", "mujoco_warp", "newton")


def _light(setup):
    """(q, v, control) at random, with torques that fit a light pendulum."""
    inertia = setup.plant.mass * setup.plant.length**2
    return [(q, v, inertia * control) for q, v, control in states(setup)]


@pytest.mark.parametrize(("engine", "integrator"), lighter([*FIRST, ("newton", "mujoco_euler")]))
def test_a_gram_on_a_string_moves_as_the_map_does(engine, integrator):
    setup = setup_of(engine, integrator, PENDULUM, mass_distribution="point", mass=1e-3, length=0.2)
    assert defect(setup, _light(setup)) <= TOLERANCE[setup.engine.width]


@pytest.mark.parametrize(
    ("engine", "integrator"), lighter([x for x in FIRST if ENGINES.load(x[0]).width == 64])
)
def test_a_light_pole_keeps_its_inertia_beside_a_heavy_cart(engine, integrator):
    """In float64: a mass matrix of such different entries is not solved with in float32."""
    pole = {"mass_distribution": "point", "mass": 1e-3, "length": 0.1}
    setup = setup_of(engine, integrator, "IntegCartPole-v0", **pole)
    assert defect(setup, states(setup)) <= TOLERANCE[64]


@pytest.mark.parametrize("engine", FLOORED)
def test_what_is_too_light_is_refused_with_the_reason(engine):
    needs(engine)
    integrator = next(iter(ENGINES.load(engine).maps))
    with pytest.raises(
        ValueError, match=r"no body's moment of inertia below 1\.1e-15 kg m\^2.*use"
    ):
        new_setup(engine, integrator, PENDULUM, mass_distribution="point", mass=1e-9, length=1e-3)
