"""CasADi: equations told once, one element per step, and a solver that says how it fared."""

from __future__ import annotations

import math
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import needs, setup_of
from own_plants import CentralSpring
from pairing import pairs

from integ_gym.envs.engines.maps import one_step_map
from integ_gym.envs.ops.ops import SCALAR, split_state
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import ENGINES
from integ_gym.support.optional import load

INTEGRATORS = tuple(ENGINES.load("casadi").maps)
ADAPTIVE = ("cvodes", "idas")

RESISTED = {
    "IntegPendulum-v0": {"damping": 0.3, "friction": 0.2, "joint_limit": 1.0},
    "IntegCartPoleSwingUp-v0": {
        "damping": 0.02, "cart_damping": 0.4, "friction": 0.02, "cart_friction": 0.5,
        "track_limit": 1.0,
    },
    "IntegElasticPendulum-v0": {"damping": 0.5},
}  # fmt: skip
"""Every plant with all that resists it."""

pytestmark = pytest.mark.usefixtures("casadi")


@pytest.fixture(scope="module", name="casadi")
def _casadi():
    needs("casadi")
    return load("casadi", "casadi")


def _moderate(setup, count=10):
    """States from which Newton's method finds its way over a stop or through friction."""
    rng, n = np.random.default_rng(3), len(setup.plant.coordinates)
    limit = 0.05 if setup.plant.name == "elastic_pendulum" else 2.0
    for _ in range(count):
        q, v = rng.uniform(-limit, limit, n), rng.uniform(-3.0, 3.0, n)
        yield tuple(q.tolist()), tuple(v.tolist()), float(rng.uniform(-2.0, 2.0))


@pytest.mark.parametrize(("integrator", "env_id"), pairs(INTEGRATORS, RESISTED, strength=1))
def test_states_and_losses_are_the_maps_on_every_plant(integrator, env_id):
    """With damping, friction and stops, all of which act within the stages."""
    setup = setup_of("casadi", integrator, env_id, dt=0.002, **RESISTED[env_id])
    known = one_step_map(setup.engine.map)
    losses = tuple(0.1 * (k + 1) for k in range(len(setup.system.no_losses)))
    lost = []
    for q, v, control in _moderate(setup):
        found = setup.engine.move(SCALAR, q, v, losses, (control,))
        expected = known.step(SCALAR, setup.system, q, v, losses, (control,), 0.002)
        assert found.converged
        assert expected.converged
        for got, wanted in zip(found[:3], expected[:3], strict=True):
            np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9)
        lost.append(np.subtract(found.losses, losses))
    assert (np.max(lost, axis=0) > 1e-4).all()


FLYING = (0.5, -1.0, 0.3, 2.0, 0.4, 0.5, 0.0, 2.0, 0.0, 5.0)
PRESSED = (0.0, 0.8, 0.47, -0.5, 0.1, 0.2, -0.1, 0.3, 0.48, -0.4)
"""A quadrotor with turning rotors; a hopper whose foot is pressed into the ground and slides."""


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize(
    ("env_id", "state"), [("IntegQuadrotor-v0", FLYING), ("IntegHopper-v0", PRESSED)]
)
def test_several_controls_and_ground_contact_are_the_maps(env_id, state, integrator):
    setup = setup_of("casadi", integrator, env_id, dt=0.001)
    known, losses = one_step_map(setup.engine.map), setup.system.no_losses
    rng = np.random.default_rng(5)
    for _ in range(4):
        q, v = split_state(tuple((np.array(state) + 0.01 * rng.standard_normal(10)).tolist()))
        controls = tuple(rng.uniform(0.0, 1.0, 2).tolist())
        found = setup.engine.move(SCALAR, q, v, losses, controls)
        expected = known.step(SCALAR, setup.system, q, v, losses, controls, 0.001)
        for got, wanted in zip(
            (*found[:2], found.losses), (*expected[:2], expected.losses), strict=True
        ):
            np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9)
        assert np.abs(found.losses).max() > 0.0


@dataclass(frozen=True)
class Trapdoor(CentralSpring):
    """A spring that lets go in a band, written with every operation of a component."""

    def acceleration(self, ops, q, v, force):
        pulled = super().acceleration(ops, q, v, force)
        inside = (abs(q[0]) < 0.5) & ((q[1] > 0.0) | (v[1] <= -1.0))
        ripple = ops.sqrt(1.0 + q[0] ** 2) % 0.7 - ops.tanh(ops.minimum(q[1], 1.0 / (2.0 + q[0])))
        bent = ops.repeat(2, lambda k, carry: (0.5 * carry[0] + k,), (ripple,))[0]
        still = ops.isfinite(q[0]) & (ops.any(inside) == False)  # noqa: E712
        return ops.where(inside, 0.0 * bent, pulled[0]), ops.where(still, bent, -ops.sin(q[1]))


def test_every_operation_of_a_component_can_be_told():
    system = PlantSystem(Trapdoor())
    engine = ENGINES.load("casadi")(system, "rk", 0.01)
    rng = np.random.default_rng(5)
    for _ in range(200):
        q, v = tuple(rng.uniform(-1.5, 1.5, 2).tolist()), tuple(rng.uniform(-2.0, 2.0, 2).tolist())
        found = engine.move(SCALAR, q, v, (0.0,), (0.3,))
        expected = one_step_map("rk4").step(SCALAR, system, q, v, (0.0,), (0.3,), 0.01)
        np.testing.assert_allclose((*found.q, *found.v), (*expected.q, *expected.v), atol=1e-12)


def test_extremes_are_those_of_the_scalar_world(casadi):
    """NaN if either is: CasADi's own `fmin` and `fmax` pass it over."""
    from integ_gym.envs.engines.casadi_ops import CasadiOps, Expression, plain

    symbols = casadi.SX.sym("a"), casadi.SX.sym("b")
    for name in ("minimum", "maximum"):
        told = getattr(CasadiOps(), name)(*map(Expression, symbols))
        function = casadi.Function("f", symbols, (plain(told),))
        for pair in ((1.0, 2.0), (2.0, 1.0), (math.nan, 1.0), (1.0, math.nan)):
            np.testing.assert_equal(float(function(*pair)), getattr(SCALAR, name)(*pair))


@dataclass(frozen=True)
class Searching(CentralSpring):
    """A plant whose acceleration is looked for in a loop."""

    def acceleration(self, ops, q, v, force):
        (pull,) = ops.while_loop(lambda c: c[0] > 1.0, lambda c: (0.5 * c[0],), (q[0],))
        return pull, force[1]


@dataclass(frozen=True)
class Asking(CentralSpring):
    """A plant that asks for the value of a component."""

    def acceleration(self, ops, q, v, force):
        return (force[0], force[1]) if q[0] > 0.0 else (0.0, 0.0)


@pytest.mark.parametrize(
    ("plant", "reason"),
    [(Searching(), "`while_loop`.*engine 'native'"), (Asking(), "no truth value")],
)
def test_equations_that_cannot_be_told_are_refused(plant, reason):
    with pytest.raises(TypeError, match=reason):
        ENGINES.load("casadi")(PlantSystem(plant), "rk", 0.01)


def test_a_step_that_newton_does_not_solve_is_not_converged(capfd):
    """And says so in `info`, without an exception and without a word on the terminal."""
    env = gym.make(
        "IntegCartPole-v0", engine="casadi", integrator="collocation_radau_2", dt=0.05,
        solver={"max_iter": 1}, disable_env_checker=True,
    )  # fmt: skip
    env.reset(options={"state": (0.0, 1.0, 1.0, 5.0)})
    info = env.step(1)[4]
    assert info["solver_status"] == "not_converged"
    assert info["solver_iterations"] == 1
    assert info["solver_residual"] > 1e-6
    assert np.isfinite(env.unwrapped.state).all()
    assert tuple(capfd.readouterr()) == ("", "")


@pytest.mark.parametrize("integrator", ADAPTIVE)
def test_an_adaptive_integrator_that_gives_up_diverges(integrator, capfd):
    """And the next step is none the worse for it."""
    setup = setup_of("casadi", integrator, "IntegPendulum-v0", dt=0.0201)
    before = setup.engine.move(SCALAR, (0.5,), (3.0,), (0.0,), (1.0,))
    engine = ENGINES.load("casadi")(setup.system, integrator, 0.0201, {"max_num_steps": 10})
    motion = engine.advance(SCALAR, (0.5,), (3.0,), (((1.0,), 1),), None)
    assert not motion.finite
    assert not motion.converged
    assert setup.engine.move(SCALAR, (0.5,), (3.0,), (0.0,), (1.0,)) == before
    assert tuple(capfd.readouterr()) == ("", "")
