"""Points that touch planes: forces, rebound, sliding, ledger, and how integrators carry them."""

from functools import partial
from math import asinh, cosh, hypot, log, sqrt, tanh
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from functional_checks import compare
from gymnasium.vector import SyncVectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import ALL
from pairing import pairs
from plant_checks import check_equations_of_motion
from sameness import assert_same
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from touching import ENVIRONMENTS, Puck, Rod, RodWithoutJacobian

from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.integrators.newton import time_of_kink
from integ_gym.envs.mechanics import Kink
from integ_gym.envs.ops.ops import ARRAY, SCALAR, split_state
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import INTEGRATORS
from integ_gym.envs.steps import script_of

SLIDING = Puck(gravity=10.0, friction_speed=0.02)
RESTING = (0.0, -SLIDING.mass * SLIDING.gravity / SLIDING.stiffness)
"""Where the puck's weight has pressed it in."""


def departure(arrival, damping):
    """Speed at which a free body leaves, by Hunt and Crossley's g(arrival) = g(-departure)."""

    def spent(speed):
        return speed / damping - log(1.0 + damping * speed) / damping**2

    fastest = (1.0 - 1e-12) / damping
    return brentq(lambda u: spent(-u) - spent(arrival), 0.0, min(arrival, fastest), xtol=1e-14)


def moved(plant, integrator, dt, q, v, steps, control=0.0, system=PlantSystem):
    engine = NativeEngine(system(plant), integrator, dt)
    return engine.advance(SCALAR, q, v, (((control,), steps),), None)


def residual(plant, q, v, motion):
    system = PlantSystem(plant)
    change = system.energy(SCALAR, motion.q, motion.v) - system.energy(SCALAR, q, v)
    return change - motion.work + sum(motion.losses)


def draw(plant, rng, speed=1.0):
    n = len(plant.coordinates)
    return tuple(rng.uniform(-0.02, 0.01, n)), tuple(speed * rng.normal(size=n))


@pytest.mark.parametrize("owner", [Puck, Rod])
def test_plants_that_touch_are_what_they_say(owner):
    check_equations_of_motion(owner())


@given(z=st.floats(-0.1, 0.1), v=st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)))
@settings(max_examples=200)
def test_a_plane_pushes_rubs_and_only_takes_energy(z, v):
    (contact,) = SLIDING.contacts
    touch, force, damped, rubbed = contact.reaction(SCALAR, (0.0, z), v)
    energy = touch.stored_energy
    assert touch.penetration == max(-z, 0.0)
    assert touch.normal_force >= 0.0
    assert touch.tangential_force * v[0] <= 0.0
    assert abs(touch.tangential_force) <= 0.5 * touch.normal_force
    assert min(damped, rubbed, energy) >= 0.0
    assert force == (touch.tangential_force, touch.normal_force)
    stored = -SLIDING.stiffness * touch.penetration * v[1]
    power = force[0] * v[0] + force[1] * v[1]
    assert power + stored + damped + rubbed == pytest.approx(0.0, abs=1e-9 * (1.0 + abs(power)))
    if z >= 0.0:
        assert touch == (0.0,) * len(touch)
        assert (damped, rubbed) == (0.0, 0.0)


@pytest.mark.parametrize(
    "plant",
    [
        Puck(pull=1.0, damping=0.3),
        Rod(),
        Pendulum(joint_limit=1.0, damping=0.1, friction=0.3, friction_speed=0.5),
        Pendulum(joint_limit=1.0, stop_damping=2.0),
        Pendulum(friction=1.0, friction_speed=0.5),
    ],
)
def test_slopes_are_those_of_the_accelerations(plant):
    """Of contacts with the ground, and of stops."""
    system, rng, n, small = (
        PlantSystem(plant),
        np.random.default_rng(0),
        len(plant.coordinates),
        1e-7,
    )
    for speed in (0.01, 1.0) * 50:
        q, v = draw(plant, rng, speed)
        q = tuple(rng.uniform(-2.0, 2.0, 1)) if n == 1 else q

        def accelerations(y):
            return np.array(system.rates(SCALAR, tuple(y[:n]), tuple(y[n:]), (0.7,))[0])

        y, shifts = np.array([*q, *v]), small * np.eye(2 * n)
        wanted = [(accelerations(y + s) - accelerations(y - s)) / (2.0 * small) for s in shifts]
        found = np.hstack(system.slopes(SCALAR, q, v, (0.7,)))
        np.testing.assert_allclose(found, np.transpose(wanted), rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize(("arrival", "damping"), [(0.5, 0.4), (2.0, 0.05), (2.0, 2.0), (8.0, 0.4)])
def test_a_rebound_has_the_analytic_speed_and_friction_its_impulse(arrival, damping):
    """Of a slip that friction does not end, μ times the impulse of the plane is lost."""
    plant = Puck(gravity=0.0, friction=0.3, friction_speed=1e-5, plane_damping=damping)
    q, v = (0.0, 0.01), (20.0, -arrival)
    motion = moved(plant, "reference", 0.1, q, v, 2)
    leaving = departure(arrival, damping)
    slip = 20.0 - 0.3 * (arrival + leaving)
    assert motion.q[1] > 0.0
    assert motion.v == pytest.approx((slip, leaving), rel=1e-9)
    lost = 0.5 * (arrival**2 - leaving**2), 0.5 * (20.0**2 - slip**2)
    assert motion.losses == pytest.approx((0.0, *lost), rel=1e-9)
    assert abs(residual(plant, q, v, motion)) < 1e-10


@pytest.mark.parametrize("friction_speed", [0.1, 0.01, 0.001])
def test_a_sliding_body_stops_where_coulomb_says_and_creeps_no_further_than_stated(friction_speed):
    """v²/2μg, and of the smoothing v_s² (1/2 + ln(2v/v_s)) / 2μg, to the order of v_s⁴."""
    plant = Puck(gravity=10.0, friction_speed=friction_speed)
    slowing = plant.friction * plant.gravity
    motion = moved(plant, "reference", 0.5, RESTING, (1.0, 0.0), 20)
    exact = hypot(1.0, friction_speed) + friction_speed**2 * asinh(1.0 / friction_speed)
    assert motion.q[0] == pytest.approx(exact / (2.0 * slowing), abs=1e-9)
    creep = friction_speed**2 * (0.5 + log(2.0 / friction_speed)) / (2.0 * slowing)
    assert motion.q[0] - 1.0 / (2.0 * slowing) == pytest.approx(creep, rel=3.0 * friction_speed**2)
    assert motion.losses == pytest.approx((0.0, 0.0, 0.5), abs=1e-10)
    assert motion.q[1] == pytest.approx(RESTING[1], abs=1e-13)


def test_a_body_that_friction_holds_creeps_as_stated():
    plant = Puck(gravity=10.0, pull=3.0, friction_speed=0.01)
    motion = moved(plant, "reference", 0.1, RESTING, (0.0, 0.0), 10)
    assert motion.v[0] == pytest.approx(0.01 * 0.6 / sqrt(1.0 - 0.6**2), rel=1e-9)


@pytest.mark.parametrize("friction_speed", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("dt", [0.01, 0.2])
def test_a_change_of_sliding_direction_is_gone_through(friction_speed, dt):
    """Braked by 13 m/s² and driven back by 3 m/s²: the time is an integral over the slip.

    With s = v_s sinh u friction is 5 tanh u, and dt = v_s cosh u du / (8 + 5 tanh u).
    """
    plant = Puck(gravity=10.0, friction_speed=friction_speed)
    motion = moved(plant, "reference", dt, RESTING, (1.0, 0.0), round(0.2 / dt), control=-8.0)
    ends = [asinh(s / friction_speed) for s in (motion.v[0], 1.0)]
    time, _ = quad(
        lambda u: friction_speed * cosh(u) / (8.0 + 5.0 * tanh(u)), *ends, epsabs=1e-14, limit=200
    )
    assert -0.4 < motion.v[0] < -0.3
    assert time == pytest.approx(0.2, abs=2e-12)
    assert abs(residual(plant, RESTING, (1.0, 0.0), motion)) < 1e-12


def by_dop853(plant, q, v, control, duration):
    """State and losses by `solve_ivp`, one smooth piece after the other."""
    system, n = PlantSystem(plant), len(q)

    def gap(t, y, index):
        return plant.contacts[index].frame(SCALAR, tuple(y[:n])).gap

    def slope(t, y):
        acceleration, losses = system.rates(SCALAR, tuple(y[:n]), tuple(y[n : 2 * n]), (control,))
        return *y[n : 2 * n], *acceleration, *losses

    events = [partial(gap, index=i) for i in range(len(plant.contacts))]
    for event in events:
        event.__dict__["terminal"] = True
    t, y = 0.0, np.array([*q, *v, *system.no_losses])
    while t < duration:
        part = solve_ivp(
            slope, (t, duration), y, "DOP853", rtol=1e-13, atol=1e-14, events=events, max_step=1e-3
        )
        t, y = part.t[-1], part.y[:, -1]
        if t < duration:  # a step too short to matter leads across
            y, t = y + 1e-12 * np.array(slope(t, y)), t + 1e-12
    return y


def agrees_with_dop853(plant, q, v, control, duration, tolerance):
    motion = moved(plant, "reference", duration, q, v, 1, control)
    got = np.array([*motion.q, *motion.v, *motion.losses])
    expected = by_dop853(plant, q, v, control, duration)
    np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance)
    assert motion.converged
    return motion


@pytest.mark.parametrize(
    ("plant", "q", "v", "control"),
    [
        (Puck(), (0.0, 0.02), (1.0, -1.0), 0.0),
        (Puck(stiffness=1e5, damping=0.1), (0.0, 0.005), (0.1, -2.0), -30.0),
        (Rod(), (0.0, 0.04, 0.3), (0.5, -1.0, 0.0), 0.0),
        (Rod(friction_speed=0.2), (0.0, 0.001, 0.0), (-1.0, -1.0, 4.0), 1.0),
    ],
    ids=["puck", "hard and driven back", "rod", "rod turned"],
)
def test_reference_through_contact_agrees_with_dop853(plant, q, v, control):
    motion = agrees_with_dop853(plant, q, v, control, 0.15, 2e-9)
    assert min(sum(motion.losses[1::2]), sum(motion.losses[2::2])) > 1e-4


def test_a_slip_that_almost_turns_within_a_step_is_seen():
    """It comes down to 1e-4 m/s between two speeds of 0.05 m/s, and at 0 friction is a wall.

    The plane's push swings, so that a step across all of this is right but for 7e-11 m/s.
    """
    plant = Puck(gravity=10.0, plane_damping=0.0, friction_speed=1e-7)
    state = RESTING, (0.0501, 50.0 * RESTING[1])

    class Blind(PlantSystem):
        def kinks(self, *given):
            return super().kinks(*given)[:-1]

    fine = moved(plant, "reference", 2e-5, *state, 2500, control=5.0)
    slips = [
        moved(plant, "reference", 0.05, *state, 1, 5.0, system).v[0]
        for system in (PlantSystem, Blind)
    ]
    assert slips[0] == pytest.approx(fine.v[0], abs=2e-12)
    assert abs(slips[1] - fine.v[0]) > 2e-11


@pytest.mark.parametrize("when", [0.013, 0.05, 0.087])
def test_a_grazing_touch_is_seen(when):
    """A puck that is pulled off the plane, and gets 1e-5 m into it at any moment of a step."""
    arrival = 2.0 * when
    q, v = (0.0, 0.5 * arrival * when - 1e-5), (0.5, -arrival)
    motion = agrees_with_dop853(Puck(gravity=-2.0, stiffness=1e6), q, v, 0.0, 0.1, 1e-9)
    assert motion.losses[1] > 0.0


class Scripted:
    """A system whose kinks are straight lines in time, which is its only coordinate."""

    def __init__(self, *lines):
        self.lines = lines

    def kinks(self, ops, q, v, control):
        return tuple([Kink(a + b * q[0], b, layer) for a, b, layer in self.lines])


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([(1.0, -4.0, None), (1.0, -5.0, 0.1), (-1.0, 3.0, None)], 0.2),
        ([(1.0, -4.0, None), (-1.0, 5.0, 0.1)], 0.2),
        ([(1.0, -4.0, None), (0.01, -0.05, 0.1)], 0.25),
        ([(1.0, -0.5, None), (0.01, -0.05, 0.1)], -1.0),
        ([(-1.0, 4.0, None), (2.0, -1.0, 0.0)], 0.25),
    ],
    ids=["the earliest", "from below", "within its layer", "none", "leaving"],
)
def test_the_first_of_several_kinks_is_told(lines, expected):
    found = time_of_kink(SCALAR, Scripted(*lines), 1, (0.0, 1.0), (1.0, 1.0), 0.0, 1.0)
    assert found == pytest.approx(expected)


@pytest.mark.parametrize("plant", [Puck(), Rod(), Rod(friction=0.0), Rod(plane_damping=0.0)])
def test_friction_and_contact_create_no_energy_on_the_truth(plant):
    """From 16 random falls, undriven: energy only falls, by what is booked, at every 5 ms."""
    rng, lanes = np.random.default_rng(1), 16
    system = PlantSystem(plant)
    engine = NativeEngine(system, "reference", 0.005)
    q = tuple(rng.uniform(-0.02, 0.05, (len(plant.coordinates), lanes)))
    v = tuple(rng.normal(size=(len(plant.coordinates), lanes)))
    total = np.zeros((1 + 2 * len(plant.contacts), lanes))
    for _ in range(40):
        before = system.energy(ARRAY, q, v)
        motion = engine.advance(ARRAY, q, v, (((np.zeros(lanes),), 1),), None)
        q, v = motion.q, motion.v
        losses = np.array([np.broadcast_to(x, lanes) for x in motion.losses])
        change = system.energy(ARRAY, q, v) - before
        assert np.all(losses >= -1e-15)
        assert np.all(change <= 1e-11)
        assert np.abs(change + losses.sum(axis=0)).max() < 1e-10
        assert np.all(motion.converged)
        total += losses
    for damped, rubbed in total[1:].reshape(-1, 2, lanes):
        assert (damped.max() > 1e-3) == (plant.plane_damping > 0.0)
        assert (rubbed.max() > 1e-3) == (plant.friction > 0.0)


@pytest.mark.parametrize("integrator", ALL)
def test_rebound_and_distance_go_to_the_closed_forms_at_order(integrator, monkeypatch):
    """The table of docs/reference/environments.md: at hω of 1, 1/4 and 1/16."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3] / "benchmarks"))
    import contact

    exact = integrator == "reference"
    steps = contact.STEPS[:1] if exact else contact.STEPS
    bounced = [contact.rebounds(integrator, dt) - contact.restitution() for dt in steps]
    come = [contact.slid(integrator, dt) - contact.distance() for dt in steps]
    worst, off = np.abs(bounced).max(axis=1), np.abs(come)
    if exact:
        assert max(*worst, *off) < 1e-6
        return
    own = INTEGRATORS.load(integrator)
    gain = 0.5 * 16.0 ** min(own.order, 2)
    assert worst[2] < worst[0] / gain
    assert off[2] < max(off[0] / gain, 1e-5)
    sliding = contact.SLIDING
    braking = sliding.friction * sliding.gravity / sliding.friction_speed
    rubbed, pressed = (contact.stable_step(integrator, coordinate) for coordinate in (0, 1))
    assert rubbed == pytest.approx(own.theory.decay_limit / braking, rel=1e-3)
    damped = contact.SLIDING.gravity * contact.SLIDING.plane_damping / contact.RATE**2
    still = own.theory.oscillation_limit / contact.RATE or damped
    assert pressed == pytest.approx(still, rel=0.03)


@pytest.mark.parametrize("integrator", ["implicit_euler", "implicit_midpoint", "stormer_verlet"])
def test_newton_copes_with_contact_with_and_without_a_jacobian(integrator):
    """It takes few iterations where slopes are given, and gets to the same place without."""
    rng = np.random.default_rng(2)
    lanes = 100
    q = tuple(rng.uniform(-0.02, 0.02, (3, lanes)))
    v = tuple(rng.normal(size=(3, lanes)))
    ends = []
    for owner in (Rod, RodWithoutJacobian):
        engine = NativeEngine(PlantSystem(owner()), integrator, 0.002)
        motion = engine.advance(ARRAY, q, v, (((0.3,), 5),), None)
        assert np.mean(motion.converged) > 0.99
        ends.append(np.array([*motion.q, *motion.v])[:, np.broadcast_to(motion.converged, lanes)])
    assert np.max(motion.iterations) < 30
    np.testing.assert_allclose(*ends, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(
    ("env_id", "integrator"),
    [
        ("TouchingPuck-v0", "symplectic_euler"),
        ("TouchingRod-v0", "rk4"),
        pytest.param("TouchingRod-v0", "implicit_midpoint", marks=pytest.mark.slow),
        pytest.param("TouchingRod-v0", "reference", marks=pytest.mark.slow),
    ],
)
def test_single_vector_and_compiled_forms_agree(env_id, integrator):
    arguments = {"integrator": integrator, "duration": 0.8}
    plain, compiled = (
        gym.make_vec(env_id, num_envs=3, compiled=c, **arguments) for c in (False, True)
    )
    single = SyncVectorEnv([partial(gym.make, env_id, **arguments)] * 3)
    first = [env.reset(seed=4) for env in (plain, compiled, single)]
    assert_same(first[1], first[0])
    assert_same(first[2], first[0])
    plain.action_space.seed(0)
    touched = 0
    for _ in range(60):
        actions = plain.action_space.sample()
        expected, made, each = (env.step(actions) for env in (plain, compiled, single))
        assert_same(made, expected)
        assert_same(each, expected, rtol=1e-9 if integrator == "reference" else 1e-12)
        touched += (expected[4]["slip_loss"] > 0.0).sum()
    assert touched > 20


@pytest.mark.parametrize(
    ("env_id", "integrator"), pairs(ENVIRONMENTS, ["rk4", "stormer_verlet"], strength=1)
)
def test_jax_agrees(env_id, integrator):
    named = f"touching:{env_id}"
    compare(named, {"integrator": integrator}, steps=15, lanes=4)
    assert script_of(environment_setup(named, {"integrator": integrator})) is not None


def test_info_tells_of_every_contact():
    given = {"integrator": "rk4", "dt": 0.001, "control_period": 0.02}
    env = gym.make("TouchingRod-v0", **given)
    fine = gym.make("TouchingRod-v0", **{**given, "control_period": 0.001})
    start = {"state": (0.0, 1.0, 0.02, -1.0, 0.1, 0.0)}
    _, reset = env.reset(options=dict(start))
    fine.reset(options=dict(start))
    told, steps = [], []
    for _ in range(5):
        *_, info = env.step(np.zeros(1))
        own = [fine.step(np.zeros(1))[4] for _ in range(20)]
        told.append(info)
        steps.append(own)
        assert reset.keys() == info.keys()
        for name in ("left", "right"):
            deepest = max(each[f"{name}_penetration"] for each in own)
            assert info[f"{name}_penetration"] == deepest
            for figure in ("normal_force", "tangential_force", "slip_speed"):
                assert info[f"{name}_{figure}"] == own[-1][f"{name}_{figure}"]
            slip, push = (info[f"{name}_{figure}"] for figure in ("slip_speed", "normal_force"))
            rub = -0.6 * push * slip / hypot(slip, 0.05)
            assert info[f"{name}_tangential_force"] == pytest.approx(rub)
        both = [f"{name}_normal_force" for name in ("left", "right")]
        assert info["contact_force"] == max(each[name] for each in own for name in both)
        assert info["slip_loss"] == pytest.approx(sum(each["slip_loss"] for each in own))
        assert info["contact_loss"] >= info["slip_loss"] >= 0.0
        for sum_of in ("contact_loss", "slip_loss"):
            parts = [info[f"{name}_{sum_of}"] for name in ("left", "right")]
            assert info[sum_of] == pytest.approx(sum(parts), abs=1e-15)
            assert min(parts) >= 0.0
        stored = [2e3 * own[-1][f"{name}_penetration"] ** 2 for name in ("left", "right")]
        assert [info[f"{n}_stored_energy"] for n in ("left", "right")] == pytest.approx(stored)
        moving = env.unwrapped.setup.plant.energy(SCALAR, *split_state(env.unwrapped.state))
        assert info["energy"] == pytest.approx(moving + sum(stored), abs=1e-12)
    assert all(max(i[f"{n}_penetration"] for i in told) > 0.0 for n in ("left", "right"))
    figures = [name for name in info if name.startswith(("left_", "right_"))]
    assert len(figures) == 14
    assert "slip_loss" not in gym.make("IntegPendulum-v0").reset(seed=0)[1]
