"""Stops: force, rebound, ledger and how integrators and environments carry them."""

from functools import cache
from math import log, pi

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import ALL
from pairing import pairs
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.numerics.identity import declared
from integ_gym.envs.ops.ops import ARRAY, SCALAR, split_state
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.contact import Stops
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.plants.system import PlantSystem

speeds = st.floats(-50.0, 50.0)
angles = st.floats(-3.0, 3.0)


def measure(speed: float, damping: float) -> float:
    """Hunt and Crossley's g, equal for a speed of arrival and minus the speed of departure."""
    return speed / damping - log(1.0 + damping * speed) / damping**2


def departure(arrival: float, damping: float) -> float:
    """Speed at which a free body leaves a stop."""
    whole = measure(arrival, damping)
    fastest = (1.0 - 1e-12) / damping
    return float(brentq(lambda u: measure(-u, damping) - whole, 0.0, min(arrival, fastest)))


@given(x=angles, v=speeds, d=st.floats(0.0, 5.0))
@settings(max_examples=100)
def test_a_stop_pushes_inwards_and_only_takes_energy(x, v, d):
    stops = Stops(0, 1.0, 200.0, d)
    contact = stops.contact(SCALAR, (x,), (v,))
    assert contact.penetration == max(abs(x) - 1.0, 0.0)
    assert contact.force * x <= 0.0
    assert contact.dissipated >= 0.0
    assert contact.energy == pytest.approx(100.0 * contact.penetration**2)
    assert (contact.penetration > 0.0) == (stops.clearance(SCALAR, (x,), (v,))[0] < 0.0)
    if contact.penetration == 0.0:
        assert contact == (0.0, 0.0, 0.0, 0.0)
    power = contact.force * v
    stored = 200.0 * contact.penetration * v * np.sign(x)
    assert power + stored + contact.dissipated == pytest.approx(0.0, abs=1e-9 * (1 + abs(power)))


@pytest.mark.parametrize(("arrival", "damping"), [(0.5, 0.4), (2.0, 0.05), (2.0, 2.0), (8.0, 0.4)])
def test_rebound_has_the_analytic_speed(arrival, damping):
    """The reference's rebound and its loss against g(arrival) = g(-departure)."""
    plant = Pendulum(gravity=0.0, joint_limit=1.0, stop_stiffness=1e3, stop_damping=damping)
    engine = NativeEngine(PlantSystem(plant), "reference", 0.1)
    motion = engine.advance(SCALAR, (1.0,), (arrival,), (((0.0,), 2),), None)
    leaving = departure(arrival, damping)
    assert motion.q[0] < 1.0
    assert motion.v[0] == pytest.approx(-leaving, rel=1e-9)
    lost = 0.5 * plant.inertia * (arrival**2 - leaving**2)
    assert motion.losses[1] == pytest.approx(lost, rel=1e-9)
    assert motion.losses[0] == 0.0


def exact(plant, q, v, control, duration):
    """State and losses by `solve_ivp`, one smooth piece after the other."""
    bare, stops, n = PlantSystem(plant), plant.stops, len(q)
    side = float(np.sign(q[0])) if abs(q[0]) > stops.limit else 0.0

    def slope(t, y):
        q, v = tuple(y[:n]), tuple(y[n : 2 * n])
        depth = side * q[0] - stops.limit if side else 0.0
        push = stops.stiffness * depth * (1.0 + stops.damping * side * v[0])
        force = (control - side * push, *(0.0,) * (n - 1))
        lost = stops.stiffness * stops.damping * depth * v[0] ** 2
        return (*v, *plant.acceleration(SCALAR, q, v, force), plant.dissipation(SCALAR, q, v), lost)

    def touch(t, y):
        return abs(y[0]) - stops.limit

    touch.terminal = True
    t, y = 0.0, np.array([*q, *v, *bare.no_losses])
    while t < duration:
        touch.direction = -1.0 if side else 1.0
        part = solve_ivp(
            slope, (t, duration), y, "DOP853", rtol=1e-13, atol=1e-14, events=touch, max_step=1e-3
        )
        t, y = part.t[-1], part.y[:, -1]
        side = 0.0 if side else float(np.sign(y[0]))
    return y


@pytest.mark.parametrize(
    ("plant", "q", "v", "control"),
    [
        (CartPole(track_limit=1.0, stop_stiffness=1e5), (0.97, 2.0), (1.5, 3.0), 4.0),
        (
            CartPole(track_limit=1.0, stop_stiffness=1e5, damping=0.02),
            (-0.9, 0.4),
            (-3.0, 1.0),
            0.0,
        ),
        (CartPole(track_limit=1.0), (0.99, 3.0), (0.5, -2.0), -5.0),
        (Pendulum(joint_limit=1.0, stop_stiffness=1e5), (0.95,), (2.0,), 1.0),
        (Pendulum(joint_limit=1.0, stop_stiffness=1e5, damping=0.3), (-0.8,), (-6.0,), 0.0),
    ],
    ids=["cart", "cart left", "soft", "pendulum", "pendulum left"],
)
def test_reference_through_a_stop_agrees_with_dop853(plant, q, v, control):
    system = PlantSystem(plant)
    motion = NativeEngine(system, "reference", 0.1).advance(SCALAR, q, v, (((control,), 1),), None)
    truth = exact(plant, q, v, control, 0.1)
    assert motion.losses[1] > 0.0
    got = np.array([*motion.q, *motion.v, *motion.losses])
    np.testing.assert_allclose(got, truth, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("depth", "when"), pairs((-1e-7, 1e-7, 1e-5, 1e-4), (0.013, 0.05, 0.087), strength=1)
)
def test_reference_sees_a_grazing_touch(depth, when):
    """A free body that turns back just beyond the limit, at any moment within the step."""
    plant = Pendulum(gravity=0.0, joint_limit=1.0, stop_stiffness=1e5)
    pull = -1.0
    arrival = -pull / plant.inertia * when
    q = 1.0 + depth - 0.5 * arrival * when
    engine = NativeEngine(PlantSystem(plant), "reference", 0.1)
    motion = engine.advance(SCALAR, (q,), (arrival,), (((pull,), 1),), None)
    truth = exact(plant, (q,), (arrival,), pull, 0.1)
    got = np.array([*motion.q, *motion.v, *motion.losses])
    np.testing.assert_allclose(got, truth, rtol=0, atol=1e-9)


def test_a_given_state_may_be_beyond_a_stop_and_a_drawn_one_not():
    env = gym.make("IntegPendulum-v0", joint_limit=2.0, stop_stiffness=10.0, start="hanging")
    env.reset(seed=0)
    assert env.unwrapped.state[0] == 2.0
    _, info = env.reset(options={"state": (2.5, 0.0)})
    assert env.unwrapped.state[0] == 2.5
    plant = env.unwrapped.setup.plant
    expected = plant.energy(SCALAR, (2.5,), (0.0,)) + 0.5 * 10.0 * 0.5**2
    assert info["energy"] == pytest.approx(expected)


def test_the_ledger_names_force_and_penetration_at_the_ends_of_sub_steps():
    env = gym.make(
        "IntegPendulum-v0", integrator="rk4", dt=0.005, control_period=0.05, joint_limit=1.0
    )
    fine = gym.make("IntegPendulum-v0", integrator="rk4", dt=0.005, joint_limit=1.0)
    for each in (env, fine):
        each.reset(options={"state": (0.9, 4.0)})
    *_, info = env.step(np.zeros(1))
    steps = [fine.step(np.zeros(1))[4] for _ in range(10)]
    assert info["penetration"] == max(step["penetration"] for step in steps) > 0.0
    assert info["contact_force"] == min(step["contact_force"] for step in steps) < 0.0
    assert info["contact_loss"] == pytest.approx(sum(step["contact_loss"] for step in steps))


@pytest.mark.parametrize(
    ("env_id", "start", "arguments"),
    [
        ("IntegPendulum-v0", (0.9, 4.0), {"joint_limit": 1.0, "damping": 0.1}),
        ("IntegCartPoleSwingUp-v0", (2.35, 3.0, 3.0, 1.0), {"cart_damping": 0.2}),
    ],
)
def test_what_stops_store_and_take_closes_the_ledger(env_id, start, arguments):
    """On the truth: motion, what is stored in the stop, work, and what each of the losses took."""
    given = {"integrator": "reference", "dt": 0.01, **arguments}
    env = gym.make(env_id, **given).unwrapped
    _, first = env.reset(options={"state": start})
    plant, stored, gone, compressed = env.setup.plant, 0.0, 0.0, []
    for k in range(30):
        *_, info = env.step(np.full(1, np.sin(k)))
        gone += info["actuator_work"] - info["dissipated"] - info["stop_contact_loss"]
        stored = info["stop_stored_energy"]
        moving = plant.energy(SCALAR, *split_state(env.state))
        assert moving + stored == pytest.approx(first["energy"] + gone, abs=1e-9)
        beyond = max(0.0, abs(env.state[0]) - plant.stops.limit)
        assert stored == pytest.approx(0.5 * plant.stop_stiffness * beyond**2, abs=1e-12)
        assert info["stop_contact_loss"] == info["contact_loss"] >= 0.0
        compressed.append(stored)
    assert max(compressed) > 0.1
    assert first["stop_stored_energy"] == first["stop_contact_loss"] == compressed[-1] == 0.0
    assert first.keys() == info.keys()


@pytest.mark.parametrize(
    ("env_id", "arguments", "message"),
    [
        ("IntegPendulum-v0", {"joint_limit": 0.0}, "`joint_limit` must be a finite number above 0"),
        ("IntegCartPole-v0", {"track_limit": -1.0}, "`track_limit` must be a finite number above"),
        ("IntegCartPole-v0", {"stop_stiffness": 0.0}, "`stop_stiffness` must be"),
        ("IntegCartPole-v0", {"stop_damping": -1.0}, "`stop_damping` must be"),
        ("IntegCartPoleSwingUp-v0", {"track_limit": None}, "`track_limit` must be"),
        ("IntegPendulum-v0", {"contact": "engine"}, "needs stops, .* has none; give its limit"),
        ("IntegQuadrotor-v0", {"contact": "engine"}, "has none; leave `contact` out"),
        ("IntegHopper-v0", {"contact": "engine"}, "measured by benchmarks/engine_contact.py"),
        ("IntegPendulum-v0", {"friction": -1.0}, "`friction` must be"),
        ("IntegPendulum-v0", {"friction_speed": 0.0}, "`friction_speed` must be"),
    ],
)
def test_impossible_stops_and_friction_are_refused(env_id, arguments, message):
    with pytest.raises(ValueError, match=message):
        gym.make(env_id, **arguments)


@pytest.mark.parametrize(
    ("integrator", "left", "made_up"),
    [
        ("explicit_euler", (2.69, 7.58), (21.61, 31.66)),
        ("symplectic_euler", (1.19, 4.48), (1.50, 10.63)),
        ("implicit_midpoint", (1.55, 1.74), (-0.01, 0.63)),
        ("stormer_verlet", (1.29, 1.71), (-0.89, 0.24)),
        ("reference", (1.44, 1.44), (0.0, 0.0)),
        ("rk4", (1.38, 1.52), (-0.06, 0.43)),
        ("implicit_euler", (0.47, 0.52), (-3.38, -3.10)),
    ],
)
def test_energy_that_a_rebound_leaves(integrator, left, made_up):
    """The table of docs/reference/environments.md: touched at 25 places within a step."""
    starts = np.tile([2.33, 3.0, pi, 0.0], (25, 1))
    starts[:, 0] -= 3.0 * 0.02 * np.arange(25) / 25
    env = gym.make_vec("IntegCartPoleSwingUp-v0", num_envs=25, integrator=integrator)
    _, info = env.reset(options={"state": starts})
    np.testing.assert_allclose(info["energy"], 4.95)
    residual = np.zeros(25)
    for _ in range(10):
        *_, info = env.step(np.zeros((25, 1)))
        residual += info["energy_residual"]
    assert (info["energy"].min(), info["energy"].max()) == pytest.approx(left, abs=0.006)
    assert (residual.min(), residual.max()) == pytest.approx(made_up, abs=0.006)


DRIVEN = CartPole(
    damping=0.02, cart_damping=0.4, track_limit=0.3, stop_stiffness=500.0, stop_damping=0.5
)


@cache
def _driven(integrator: str, substeps: int) -> dict[str, np.ndarray]:
    """What 64 random starts book in 0.5 s of random controls between the stops, J, shape (64,)."""
    rng, lanes = np.random.default_rng(4), 64
    system = PlantSystem(DRIVEN)
    engine = NativeEngine(system, integrator, 0.05 / substeps)
    q = rng.uniform(-0.2, 0.2, lanes), pi + rng.uniform(-0.6, 0.6, lanes)
    v = rng.uniform(-3.0, 3.0, lanes), rng.uniform(-1.0, 1.0, lanes)
    names = ("residual", "damping", "contact", "work", "touched")
    booked = {name: np.zeros(lanes) for name in names}
    for control in rng.uniform(-8.0, 8.0, (10, lanes)):
        before = system.energy(ARRAY, q, v)
        motion = engine.advance(ARRAY, q, v, (((control,), substeps),), None)
        q, v = motion.q, motion.v
        change = system.energy(ARRAY, q, v) - before
        booked["residual"] += np.abs(change - motion.work + sum(motion.losses))
        booked["damping"] += motion.losses[0]
        booked["contact"] += motion.losses[1]
        booked["work"] += motion.work
        booked["touched"] += motion.penetration > 0.0
    return booked


def _orders(integrator: str) -> dict[str, float]:
    """Order of the mean error of all that is booked, over an eightfold refinement."""
    truth = _driven("reference", 1)
    coarse, fine = (_driven(integrator, substeps) for substeps in (8, 64))
    return {
        name: log(
            np.abs(coarse[name] - truth[name]).mean() / np.abs(fine[name] - truth[name]).mean()
        )
        / log(8.0)
        for name in ("residual", "damping", "contact", "work")
    }


def test_the_reference_closes_the_ledger_of_many_driven_contacts():
    truth = _driven("reference", 1)
    assert truth["residual"].max() < 1e-9
    assert (truth["contact"] > 1e-6).mean() > 0.5
    assert truth["damping"].min() > 0.0


@pytest.mark.parametrize("integrator", [n for n in ALL if n != "reference"])
def test_the_ledger_closes_in_driven_damped_contact_at_order(integrator):
    """All that is booked converges to the exact motion's at order min(p, 2).

    A stop's force is continuous on touching and its rate is not: the acceleration jumps by J in its
    first derivative. A step of h with the touch at a share s of its length follows a broken line by
    its own quadrature, whose error in the velocity is c(s) J h², and in the position h times
    that. Only one step per touch errs so, while the smooth rest adds up to O(h^p): the error is
    O(h^min(p, 2)), as that of energy, losses and work, which are integrals of the motion. c(s)
    depends on where in a step the touch happens to be, changes from step size to step size, and may
    vanish, so that one motion has no order; the mean over many has.
    """
    expected = min(declared(integrator).order, 2)
    for name, order in _orders(integrator).items():
        assert order == pytest.approx(expected, abs=0.3), name


def test_a_first_order_ledger_on_rk4_is_caught_in_contact():
    assert _orders("mutants:RectangleLedger")["residual"] < 1.3
