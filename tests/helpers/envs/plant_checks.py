"""What every plant must satisfy, as functions that raise AssertionError.

The suite runs them over the registry, and over planted faults, which they must catch.
"""

from __future__ import annotations

import math
from dataclasses import fields
from functools import partial

import numpy as np
from scipy.optimize import minimize
from stated import by_hand

from integ_gym.envs.numerics.stepping import jacobian, probe_state
from integ_gym.envs.ops.ops import ARRAY, SCALAR
from integ_gym.envs.plants.interface import MASS_DISTRIBUTIONS


def _pendulum(p, q, v):
    rod = p.mass_distribution == "uniform"
    inertia = p.mass * p.length**2 / (3.0 if rod else 1.0)
    arm = p.length / 2.0 if rod else p.length
    weight = p.mass * p.gravity * arm * math.sin(q[0])
    return [[inertia]], [weight], p.damping * v[0] ** 2


def _cart_pole(p, q, v):
    rod = p.mass_distribution == "uniform"
    inertia = p.mass * p.length**2 * (4.0 / 3.0 if rod else 1.0)
    coupling = p.mass * p.length * math.cos(q[1])
    weight = p.mass * p.gravity * p.length * math.sin(q[1])
    lost = p.cart_damping * v[0] ** 2 + p.damping * v[1] ** 2
    return [[p.cart_mass + p.mass, coupling], [coupling, inertia]], [0.0, weight], lost


def _elastic_pendulum(p, q, v):
    down = p.length + p.mass * p.gravity / p.stiffness - q[1]
    pull = p.stiffness * (1.0 - p.length / math.hypot(q[0], down))
    forces = [-pull * q[0], pull * down - p.mass * p.gravity]
    return [[p.mass, 0.0], [0.0, p.mass]], forces, p.damping * (v[0] ** 2 + v[1] ** 2)


def _quadrotor(p, q, v):
    mass = np.diag([p.mass, p.mass, p.inertia, 0.0, 0.0])
    forces = [0.0, -p.mass * p.gravity, 0.0, 0.0, 0.0]
    return mass, forces, p.damping * (v[0] ** 2 + v[1] ** 2)


def _clocked(closed_form):
    """The same, and a clock at the end."""

    def padded(p, q, v):
        mass, force, lost = closed_form(p, q, v)
        return np.pad(mass, (0, 1)), [*force, 0.0], lost

    return padded


def _hopper(p, q, v):
    """By the foot's Jacobian; a leg pulls the foot and the hip towards each other."""
    sine, cosine = math.sin(q[3] - q[2]), math.cos(q[3] - q[2])
    across, down = q[4] * sine, q[4] * cosine
    foot = np.array([[1.0, 0.0, -down, down, sine], [0.0, 1.0, -across, across, -cosine]])
    mass = np.diag([p.mass, p.mass, p.inertia, 0.0, 0.0]) + p.foot_mass * foot.T @ foot
    weight = -p.gravity * (p.foot_mass * foot[1] + [0.0, p.mass, 0.0, 0.0, 0.0])
    return (
        mass,
        weight - [0, 0, 0, 0, p.leg_stiffness * (q[4] - p.leg_length)],
        (p.damping * v[4] ** 2),
    )


def _double_pendulum(p, q, v):
    """By the centres' Jacobians: M = Σ m JᵀJ + I, and the weights' work along each coordinate."""
    upper, lower = q[0], q[0] + q[1]
    first = p.centre_1 * np.array([[math.cos(upper), 0.0], [math.sin(upper), 0.0]])
    arm = p.length_1 * np.array([[math.cos(upper), 0.0], [math.sin(upper), 0.0]])
    second = arm + p.centre_2 * np.array([[math.cos(lower)] * 2, [math.sin(lower)] * 2])
    mass = p.mass_1 * first.T @ first + p.mass_2 * second.T @ second
    mass += p.inertia_1 * np.diag([1.0, 0.0]) + p.inertia_2
    weight = -p.gravity * (p.mass_1 * first[1] + p.mass_2 * second[1])
    return mass, weight, p.damping * (v[0] ** 2 + v[1] ** 2)


def _chain(p, q, v):
    """By the middles' Jacobians, as of the double pendulum."""
    n, angles = len(q), np.cumsum(q)
    along = p.length * np.array([np.cos(angles), np.sin(angles)])
    mass, weight = np.zeros((n, n)), np.zeros(n)
    for i in range(n):
        share = np.where(np.arange(n) < i, 1.0, np.where(np.arange(n) == i, 0.5, 0.0))
        middle = (share * along) @ np.tri(n)
        turn = np.tri(n)[i]
        mass += p.mass * middle.T @ middle + p.mass * p.length**2 / 12.0 * np.outer(turn, turn)
        weight -= p.mass * p.gravity * middle[1]
    return mass, weight, p.damping * sum(x**2 for x in v)


CLOSED_FORMS = {
    "acrobot": _double_pendulum,
    "chain": _chain,
    "pendulum": _pendulum,
    "cart_pole": _cart_pole,
    "elastic_pendulum": _elastic_pendulum,
    "guided_quadrotor": _clocked(_quadrotor),
    "hopper": _hopper,
    "quadrotor": _quadrotor,
    "reacher": _clocked(_double_pendulum),
}
"""Mass matrix, generalized forces at rest and dissipated power of every plant, by hand."""

CLOSED_FORMS_PLACE = "CLOSED_FORMS of tests/helpers/envs/plant_checks.py"


def damped(owner):
    """A plant with every viscous damping and the gravity that it may have."""
    words = "damping", "gravity"
    names = [f.name for f in fields(owner) if f.name.endswith(words) and f.default == 0.0]
    return owner(**dict.fromkeys(names, 0.3))


def check_plant(owner) -> None:
    """Both checks of a plant class."""
    check_closed_forms(owner)
    check_equations_of_motion(damped(owner))


def check_closed_forms(owner) -> None:
    """Mass matrix, forces at rest and dissipation are those written by hand, to 1e-12.

    Lagrange's equations hold of a plant with a wrong moment of inertia, too: it is another plant.
    """
    rng = np.random.default_rng(7)
    for distribution in MASS_DISTRIBUTIONS:
        for _ in range(4):
            plant = _random_plant(owner, distribution, rng)
            point = probe_state(plant) + 0.3 * rng.standard_normal(2 * len(plant.coordinates))
            check_closed_forms_of(plant, point, plant.name)


def check_closed_forms_of(plant, point, form) -> None:
    """The same of a plant in a state, by the closed forms of a name."""
    q, v = tuple(point[0::2].tolist()), tuple(point[1::2].tolist())
    mass, force, lost = by_hand(CLOSED_FORMS, form, CLOSED_FORMS_PLACE)(plant, q, v)
    none = (0.0,) * len(q)
    pulled = np.array(mass) @ plant.acceleration(SCALAR, q, none, none)
    _assert_close(plant.mass_matrix(SCALAR, q), mass, 1e-12)
    _assert_close(pulled, force, 1e-12)
    _assert_close(plant.dissipation(SCALAR, q, v), lost, 1e-12)


def _random_plant(owner, distribution, rng):
    """Every number within a factor of two of its default, or up to 1 where that is zero."""
    values = {
        f.name: rng.uniform(0.5, 2.0) * f.default if f.default else rng.uniform(0.1, 1.0)
        for f in fields(owner)
        if isinstance(f.default, float)
    }
    if "mass_distribution" in (f.name for f in fields(owner)):
        values["mass_distribution"] = distribution
    return owner(**values)


def check_equations_of_motion(plant) -> None:
    """Accelerations are those of Lagrange's equations for the plant's energy and dissipation.

    d/dt ∂L/∂v − ∂L/∂q = F − ½ ∂D/∂v, all derivatives taken numerically from energy(q, v) and
    dissipation(q, v); the mass matrix is the energy's second derivative, and the Jacobian, where
    given, is the acceleration's. The energy is zero at rest at the bottom, or of a plant that
    flies, at its frame's origin, unless it needs the ground; then the gaps' slopes are the
    contacts' normal rows. A force on a massless coordinate is its acceleration.
    """
    n, contacts = len(plant.coordinates), getattr(plant, "contacts", ())

    def at_rest(q):
        return plant.energy(SCALAR, tuple(q), (0.0,) * n)

    if not contacts:
        flies = hasattr(plant, "massless")
        bottom = (0.0,) * n if flies else minimize(at_rest, probe_state(plant)[0::2]).x
        assert abs(at_rest(bottom)) < 1e-9
    assert len(contacts) == len(getattr(plant, "contact_names", ()))
    rng = np.random.default_rng(2)
    for _ in range(8):
        point = probe_state(plant) + 0.3 * rng.standard_normal(2 * n)
        q, v = point[0::2], point[1::2]
        force = rng.uniform(-2.0, 2.0, n)
        mass, expected = _lagrange(plant, q, v, force)
        found = plant.acceleration(SCALAR, tuple(q), tuple(v), tuple(force))
        _assert_close(found, expected, 1e-7)
        _assert_close(plant.mass_matrix(SCALAR, tuple(q)), mass, 1e-8)
        for contact in contacts:
            slopes = jacobian(partial(_gap, contact), q)
            _assert_close(contact.frame(SCALAR, tuple(q)).normal, slopes[0], 1e-8)
        if hasattr(plant, "jacobian"):
            _check_jacobian(plant, np.concatenate([q, v]), force, 1.0 + np.abs(expected).max())


def _lagrange(plant, q, v, force):
    """Mass matrix and accelerations from the derivatives of energy and dissipation."""
    n, here = len(q), np.concatenate([q, v])
    by_state = jacobian(lambda z: _gradient(plant, z)[:, n:], here)
    twist, mass = by_state[:, :n], by_state[:, n:]
    rest = _gradient(plant, np.concatenate([q, np.zeros(n)])[None])[0, :n]
    by_q = _gradient(plant, here[None])[0, :n]
    drag = 0.5 * jacobian(lambda z: _along(plant.dissipation, z)[:, None], here)[0, n:]
    # L = T - V with E = T + V, so ∂L/∂q = ∂E/∂q - 2 ∂V/∂q
    massless = np.diag([float(i in getattr(plant, "massless", ())) for i in range(n)])
    return mass, np.linalg.solve(mass + massless, force - drag + (by_q - 2.0 * rest) - twist @ v)


def _gap(contact, points):
    """At points of shape (lanes, n), as one column."""
    return np.broadcast_to(contact.frame(ARRAY, tuple(points.T)).gap, len(points))[:, None]


def _check_jacobian(plant, here, force, scale) -> None:
    n = len(force)

    def acceleration(points):
        q, v = tuple(points.T[:n]), tuple(points.T[n:])
        columns = plant.acceleration(ARRAY, q, v, tuple(force))
        return np.stack([np.broadcast_to(x, len(points)) for x in columns], -1)

    slopes = jacobian(acceleration, here)
    by_q, by_v = plant.jacobian(SCALAR, tuple(here[:n]), tuple(here[n:]), tuple(force))
    given = np.hstack([np.array(by_q), np.array(by_v)])
    np.testing.assert_allclose(given, slopes, rtol=0, atol=1e-8 * (scale + np.abs(given).max()))


def _assert_close(found, expected, share) -> None:
    """Within a share of one plus the largest entry."""
    scale = 1.0 + np.abs(expected).max()
    np.testing.assert_allclose(np.array(found), expected, rtol=0, atol=share * scale)


def _along(function, points):
    n = points.shape[1] // 2
    values = function(ARRAY, tuple(points.T[:n]), tuple(points.T[n:]))
    return np.broadcast_to(values, len(points))


def _gradient(plant, points):
    """∂E/∂(q, v) at points of shape (lanes, 2n), by central differences."""
    slopes = [jacobian(lambda z: _along(plant.energy, z)[:, None], p)[0] for p in points]
    return np.array(slopes)
