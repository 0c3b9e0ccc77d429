"""What every integrator must satisfy, as functions that raise AssertionError.

The suite runs them over the registries, and over planted faults, which they must catch.
"""

from __future__ import annotations

import math

import numpy as np
from motions import ALL
from own_plants import CentralSpring
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

from integ_gym.envs.integrators.newton import CAP, TOLERANCE
from integ_gym.envs.numerics.accuracy import (
    convergence,
    reversibility_errors,
    symplecticity_defect,
    volume_defect,
)
from integ_gym.envs.numerics.energy import ledger
from integ_gym.envs.numerics.identity import declared
from integ_gym.envs.numerics.stepping import fastest_rate, linear_map, probe_state
from integ_gym.envs.ops.ops import SCALAR, join_state, split_state
from integ_gym.envs.plants.interface import controls_of
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import INTEGRATORS, PLANTS

APPROXIMATE = tuple(name for name in ALL if name != "reference")
NEWTON = ("implicit_euler", "implicit_midpoint", "stormer_verlet")

ORDER = 0.05
"""Largest distance of a measured order from theory."""

ROD = Pendulum(gravity=10.0)
"""Gymnasium's pendulum: ω² = 15."""

POINT = Pendulum(gravity=9.81, mass_distribution="point")


def _rk4(h):
    return np.array(
        [[1 - h**2 / 2 + h**4 / 24, h - h**3 / 6], [-h + h**3 / 6, 1 - h**2 / 2 + h**4 / 24]]
    )


LINEAR_MAPS = {
    "explicit_euler": lambda h: np.array([[1, h], [-h, 1]]),
    "implicit_euler": lambda h: np.array([[1, h], [-h, 1]]) / (1 + h * h),
    "symplectic_euler": lambda h: np.array([[1 - h * h, h], [-h, 1]]),
    "stormer_verlet": lambda h: np.array([[1 - h**2 / 2, h], [-h * (1 - h**2 / 4), 1 - h**2 / 2]]),
    "implicit_midpoint": lambda h: (
        np.array([[1 - h * h / 4, h], [-h, 1 - h * h / 4]]) / (1 + h * h / 4)
    ),
    "rk4": _rk4,
    "reference": lambda h: np.array([[math.cos(h), math.sin(h)], [-math.sin(h), math.cos(h)]]),
}
"""One step on ẍ = −x in (x, ẋ), by hand."""

LINEAR_MAPS_PLACE = "LINEAR_MAPS of tests/helpers/envs/checks.py"


def registered_plants(**arguments):
    """An instance of every registered plant, and of a user's own."""
    return [PLANTS.load(name)(**arguments) for name in PLANTS.names()] + [
        CentralSpring(**arguments)
    ]


def constant_mass_plants():
    """Of those whose motion without control is conservative."""
    plants = [plant for plant in registered_plants() if not hasattr(plant, "input_forces")]
    return [plant for plant in plants if plant.constant_mass_matrix]


def elliptic_pendulum(amplitude: float, frequency: float, time: float) -> tuple[float, float]:
    """(θ, θ̇) of a pendulum released at rest `amplitude` from hanging; θ from upright.

    sin(φ/2) = k sn(K + ωt, k²), k = sin(amplitude/2): Lawden (1989), Elliptic Functions and
    Applications, section 5.1.
    """
    k = math.sin(amplitude / 2.0)
    sn, cn, _, _ = ellipj(ellipk(k * k) + frequency * time, k * k)
    return math.pi + 2.0 * math.asin(k * sn), 2.0 * k * frequency * cn


def solved(plant, state, duration, control=0.0):
    """State at the end and (work, dissipated) by scipy's DOP853 at rounding."""
    n, system = len(plant.coordinates), PlantSystem(plant)
    controls = controls_of(plant, control)

    def rates(_, y):
        q, v = tuple(y[:n]), tuple(y[n : 2 * n])
        force = system.forces(SCALAR, q, v, controls)
        return (
            *v, *plant.acceleration(SCALAR, q, v, force),
            system.power(SCALAR, q, v, controls), plant.dissipation(SCALAR, q, v),
        )  # fmt: skip

    q, v = split_state(tuple(state))
    end = solve_ivp(rates, (0.0, duration), (*q, *v, 0.0, 0.0), "DOP853", rtol=1e-13, atol=1e-14).y[
        :, -1
    ]
    return np.array(join_state(tuple(end[:n]), tuple(end[n : 2 * n]))), end[2 * n :]


def check_order_on_the_pendulum(integrator: str) -> None:
    """Order against the Jacobi elliptic solution, norm (q, p/ω), T = 0.5 s, h = T/2⁴ … T/2⁹."""
    omega = math.sqrt(15.0)
    for amplitude in (math.pi / 2, 1.0):
        truth = elliptic_pendulum(amplitude, omega, 0.5)
        start = (math.pi + amplitude, 0.0)
        found = convergence(integrator, ROD, start, 0.5, truth, omega)
        assert found.order is not None
        assert abs(found.order - declared(integrator).order) < ORDER, found


def check_order_on(integrator: str, plant, control: float = 0.0) -> None:
    """Order against `solve_ivp` on the motion of any plant, at its rate where it is fastest."""
    state, rate = probe_state(plant), fastest_rate(plant)
    end, _ = solved(plant, state, 2.0 / rate, control)
    rate = max(rate, fastest_rate(plant, end))
    truth, _ = solved(plant, state, 2.0 / rate, control)
    found = convergence(integrator, plant, state, 2.0 / rate, truth, rate, control)
    assert found.order is not None
    assert abs(found.order - declared(integrator).order) < ORDER, found


def check_linear_map(integrator: str, matrix) -> None:
    """One step on the harmonic oscillator is the matrix that theory gives, to 1e-12."""
    for h in (0.05, 0.3, 1.1):
        found = np.array(linear_map(integrator, h).matrix)
        np.testing.assert_allclose(found, matrix(h), rtol=0, atol=1e-12)


def check_phase_space(integrator: str) -> None:
    """|det J − 1| and max |JᵀΩJ − Ω| are below 1e-9 for symplectic methods, and for no other."""
    for plant in constant_mass_plants():
        dt = 0.5 / fastest_rate(plant)
        volume = abs(volume_defect(integrator, plant, probe_state(plant), dt))
        canonical = symplecticity_defect(integrator, plant, probe_state(plant), dt)
        if declared(integrator).symplectic:
            assert volume < 1e-9, (plant.name, volume)
            assert canonical < 1e-9, (plant.name, canonical)
        else:
            assert volume > 1e-7, (plant.name, volume)
            assert canonical > 1e-7, (plant.name, canonical)


def check_reversibility(integrator: str) -> None:
    """Forward-backward over 10 s: below 1e-13 for reversible methods, and for no other."""
    for plant in (POINT, ROD):
        for start in ((math.pi / 2, 0.0), (math.pi - 0.5, 0.0)):
            defect = float(reversibility_errors(integrator, plant, start, 0.05).max())
            assert (defect < 1e-13) is declared(integrator).reversible, (start, defect)


def check_solver(integrator: str) -> None:
    """The implicit equations hold for what the step returns, and the status is `ok`."""
    stepper = INTEGRATORS.load(integrator)()
    for plant in registered_plants(damping=0.3):
        system, rate = PlantSystem(plant), fastest_rate(plant)
        n, rng = len(plant.coordinates), np.random.default_rng(5)
        for _ in range(20):
            start = probe_state(plant) + 0.3 * rng.standard_normal(2 * n)
            q, v = split_state(tuple(start.tolist()))
            h, u = float(rng.uniform(0.1, 0.6)) / rate, float(rng.uniform(-2.0, 2.0))
            controls = controls_of(plant, u)
            step = stepper.step(SCALAR, system, q, v, system.no_losses, controls, h)
            assert step.converged, plant.name
            assert step.residual <= TOLERANCE
            assert 1 <= step.iterations <= CAP
            defect = implicit_defect(integrator, system, q, v, step, u, h)
            scale = 1.0 + max(abs(x) for x in (*v, *step.v))
            assert max(abs(x) for x in defect) < 1e-10 * scale, (plant.name, defect)


def implicit_defect(integrator: str, system, q, v, step, u, h):
    """v₁ minus what the method's equation gives for it from (q₀, v₀), written out by hand."""
    q0, v0, q1, v1 = (np.array(x) for x in (q, v, step.q, step.v))

    controls = controls_of(system.plant, u)

    def acceleration(q, v):
        return np.array(system.rates(SCALAR, tuple(q.tolist()), tuple(v.tolist()), controls)[0])

    name = next(
        n for n in NEWTON if isinstance(INTEGRATORS.load(integrator)(), INTEGRATORS.load(n))
    )
    if name == "implicit_euler":
        return v1 - v0 - h * acceleration(q1, v1)
    if name == "implicit_midpoint":
        return v1 - v0 - h * acceleration(0.5 * (q0 + q1), 0.5 * (v0 + v1))
    kicked = v0 + 0.5 * h * acceleration(q0, v0)
    return v1 - kicked - 0.5 * h * acceleration(q1, v1)


def check_ledger(integrator: str, plant) -> None:
    """In damped, driven motion the residual falls at the order, and the terms are the true ones."""
    state, rate = probe_state(plant), fastest_rate(plant)
    period = 0.2 / rate
    controls = np.random.default_rng(3).uniform(-2.0, 2.0, 10).tolist()
    truth, booked = state, np.zeros(2)
    for control in controls:
        truth, terms = solved(plant, truth, period, control)
        booked = booked + terms
    assert booked[1] > 0.0
    size = 1.0 + abs(PlantSystem(plant).energy(SCALAR, *split_state(tuple(state.tolist()))))
    order, runs = declared(integrator).order, []
    for n in (4, 8, 16, 32, 64):
        runs.append(ledger(integrator, plant, state, controls, period, n))
        found = [
            _order_of_fall(errors, order, 3e-13 * size)
            for errors in (
                [r.total_residual_j for r in runs],
                [abs(r.work_j - booked[0]) for r in runs],
                [abs(r.losses_j - booked[1]) for r in runs],
            )
        ]
        if n >= 32 and min(found) > order - 2 * ORDER:
            return  # 64 where coarse steps are not in the limit yet: Ralston's method on a chain
    raise AssertionError(f"{integrator} on {plant}: orders {found} of residual, work and losses")


def _order_of_fall(errors, order, rounding) -> float:
    """Of errors under halving, at last, or over all; the expected one where rounding hides it."""
    usable = [e for e in errors if e > rounding]
    if len(usable) < 2:
        return order
    over_all = math.log2(usable[0] / usable[-1]) / (len(usable) - 1)
    # The finest counts where coarse steps are not in the limit yet: RK4 on the acrobot.
    return max(over_all, math.log2(usable[-2] / usable[-1]))
