"""What a plant and its integrators are: whether they agree with themselves and what they claim."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.ops.ops import ARRAY, join_state, split_state
from integ_gym.envs.plants.interface import (
    Plant,
    controls_of,
    state_names,
    state_units,
)
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import TRUTH

from .lines import ANY, Diagnosis, Expectation, above, amount, below, near, undeclared
from .subject import Array, accelerations, theory_of

STATES = 32
"""Random states around rest at which the plant is asked."""

EXACT = 1e-8
"""A share that is rounding of differences."""

Z = 0.2
"""hω at which the energy factor is measured."""

OSCILLATOR = "oscillator"
"""The linear test equation, which stands for no plant."""

_SPREAD = 0.5
_RESISTANCE = 0.3
_FACTOR_TOLERANCE = 1e-9
_LIMIT_TOLERANCE = 1e-4


def diagnose_plant(diagnosis: Diagnosis) -> None:
    """Compare what the plant says of itself with differences of what it says elsewhere."""
    subject = diagnosis.subject
    resistances = subject.resistances("damping", "friction")
    plant = subject.varied(**dict.fromkeys(resistances, _RESISTANCE))
    states = states_around(subject.rest)
    q, _ = split_state(tuple(states.T))
    entries = [np.broadcast_to(x, STATES) for row in plant.mass_matrix(ARRAY, q) for x in row]
    change = float(np.ptp(np.array(entries), axis=1).max())
    words = "some: declared to depend on q", "above 0"
    if plant.constant_mass_matrix:
        words = "0: declared constant", "exactly"
    declared = Expectation(*words, (change == 0.0) is plant.constant_mass_matrix)
    left, off = rest_energy(plant, subject.rest), jacobian_defect(plant, states)

    def agree(defect: float, what: str) -> tuple[float, str, Expectation]:
        return defect, "", below(EXACT, (defect,), "", f"{what} agree")

    found: dict[str, tuple[float, str, Expectation] | None] = {
        "rate of energy − power of the control + dissipation, by the largest of them": agree(
            energy_defect(plant, states), "energy, accelerations and dissipation"
        ),
        "mass matrix × acceleration by a unit force − force": agree(
            mass_defect(plant, states), "mass matrix and accelerations"
        ),
        "change of the mass matrix between configurations": (change, "", declared),
        "Jacobian − differences of the accelerations, by the largest entry": (
            None if off is None else agree(off, "Jacobian and accelerations")
        ),
        "energy at rest": ((left, "J", near(0.0, EXACT, (left,), "J")) if subject.rests else None),
    }
    for quantity, line in found.items():
        if line is not None:
            value, unit, expectation = line
            diagnosis.add(ANY, quantity, (value,), unit, expectation)


def states_around(rest: Array) -> Array:
    """Random states around a state of shape (n,), shape (STATES, n)."""
    spread = np.random.default_rng(0).uniform(-_SPREAD, _SPREAD, (STATES, len(rest)))
    return np.asarray(rest + spread)


def rest_energy(plant: Plant, rest: Array) -> float:
    """Energy of a rest state of shape (n,), J: zero by contract."""
    return float(plant.energy(ARRAY, *split_state(tuple(rest))))


def energy_defect(plant: Plant, states: Array) -> float:
    """Largest |dE/dt − power + losses| by the largest of the terms, over states (lanes, n).

    The power is that of the controls, each at 1, in its unit.
    """
    q, v = split_state(tuple(states.T))
    system = PlantSystem(plant)
    controls = controls_of(plant, 1.0)
    acceleration, losses = system.rates(ARRAY, q, v, controls)

    def energy(shift: Array) -> Array:
        """Along the motion, at times (times, 1), shape (times, lanes)."""
        moved_q = tuple(x + shift * y for x, y in zip(q, v, strict=True))
        moved_v = tuple(x + shift * y for x, y in zip(v, acceleration, strict=True))
        return np.asarray(system.energy(ARRAY, moved_q, moved_v))

    rate = numerics.jacobian(energy, np.zeros(1))[:, 0]
    power = system.power(ARRAY, q, v, controls)
    lost = sum(losses[: len(losses) - (system.input_forces is not None)])
    terms = np.abs(np.stack(np.broadcast_arrays(rate, power, lost)))
    return float(np.abs(rate - power + lost).max() / terms.max())


def mass_defect(plant: Plant, states: Array) -> float:
    """Largest |M (a(F) − a(0)) − F| for unit forces F, over states (lanes, n).

    A unit force on a massless coordinate is its acceleration.
    """
    q, v = split_state(tuple(states.T))
    rows, free = plant.mass_matrix(ARRAY, q), plant.acceleration(ARRAY, q, v, (0.0,) * len(q))
    massless, off = getattr(plant, "massless", ()), []
    for force in np.eye(len(q)):
        pushed = plant.acceleration(ARRAY, q, v, tuple(force))
        gained = [a - b for a, b in zip(pushed, free, strict=True)]
        for i, (row, f) in enumerate(zip(rows, force, strict=True)):
            moved = sum(m * a for m, a in zip(row, gained, strict=True))
            off.append(moved + (gained[i] if i in massless else 0.0) - f)
    return float(np.abs(np.stack(np.broadcast_arrays(*off))).max())


def jacobian_defect(plant: Any, states: Array) -> float | None:
    """Largest |Jacobian − differences| by the largest entry, over states (lanes, n).

    None of a plant that gives no Jacobian.
    """
    if not hasattr(plant, "jacobian"):
        return None

    def given(state: Array) -> Array:
        still = (0.0,) * len(plant.coordinates)
        by_q, by_v = plant.jacobian(ARRAY, *split_state(tuple(state)), still)
        columns = join_state(tuple(zip(*by_q, strict=True)), tuple(zip(*by_v, strict=True)))
        return np.array(columns, dtype=np.float64).T

    def acceleration(points: Array) -> Array:
        return accelerations(plant, *split_state(tuple(points.T)))

    differences = np.array([numerics.jacobian(acceleration, state) for state in states])
    jacobians = np.array([given(state) for state in states])
    return float(np.abs(jacobians - differences).max() / np.abs(differences).max())


def diagnose_identity(diagnosis: Diagnosis) -> None:
    """Classify every integrator on the plant without its resistances."""
    subject = diagnosis.subject
    plant = subject.varied(**subject.undamped)
    for integrator in diagnosis.integrators:
        advance = diagnosis.bench.advance(f"{diagnosis.section}/{integrator}", subject)
        found = numerics.classify(integrator, plant, follow=advance)
        _add_claims(diagnosis, integrator, found)
        limit = found.stable_up_to
        stable = f"hω = {limit:.4g}"
        if subject.rests:
            stable += f", dt = {limit / subject.frequency:.3g} s"
        if limit == 0.0:
            stable = "never: oscillations grow at every step"
        diagnosis.identities.append(
            {
                "plant": subject.name,
                "integrator": integrator,
                "order": "exact to rounding" if found.order is None else round(found.order, 6),
                "symplectic": found.symplectic,
                "reversible": found.reversible,
                "stable_up_to_h_omega": round(limit, 6),
                "stable_up_to_dt_s": (
                    round(limit / subject.frequency, 6) if subject.rests else None
                ),
                "stable": "any step" if math.isinf(limit) else stable,
            }
        )
        if diagnosis.leads:
            _add_oscillator(diagnosis, integrator, limit)


def _add_claims(diagnosis: Diagnosis, integrator: str, found: numerics.Identity) -> None:
    """Order, symplecticity and reversibility, each as measured and as claimed."""
    claim, plant = numerics.declared(integrator), diagnosis.subject.plant
    expectation = undeclared()
    if found.order is None:
        exact = Expectation("0: rounding", f"below {amount(numerics.ROUNDING)} of the state", True)
        expectation = exact if integrator == TRUTH else undeclared("no error to measure it by")
    elif claim.order is not None:
        expectation = near(claim.order, numerics.ORDER_TOLERANCE, (found.order,))
    diagnosis.add(
        integrator, "order of convergence", (), "", expectation,
        order=found.order, order_steps=found.order_steps,
    )  # fmt: skip
    if found.symplectic is None:
        return
    symplectic, yes, no = claim.symplectic, "symplectic", "not symplectic"
    if integrator == TRUTH:
        symplectic, yes = True, "the exact motion is symplectic"
    elif symplectic and not plant.constant_mass_matrix:
        symplectic, no = False, "not where M depends on q"
    worst = int(np.argmax(found.reversibility_errors))
    for quantity, claimed, bound, value, unit, words in (
        (
            "symplectic, max |JᵀΩJ − Ω| of one step", symplectic, numerics.SYMPLECTIC,
            found.symplecticity_defect, "", (yes, no),
        ),
        (
            f"reversible, forward, turn, back: worst of {', '.join(state_names(plant))}",
            integrator == TRUTH or claim.reversible, numerics.REVERSIBLE,
            found.reversibility_errors[worst], state_units(plant)[worst],
            ("reversible", "not reversible"),
        ),
    ):  # fmt: skip
        expectation = undeclared()
        if claimed is not None:
            judge, why = (below, words[0]) if claimed else (above, words[1])
            expectation = judge(bound, (value,), unit, why)
        diagnosis.add(integrator, quantity, (value,), unit, expectation, steps=(found.dt,))


def _add_oscillator(diagnosis: Diagnosis, integrator: str, limit: float) -> None:
    """What the integrator does to a harmonic oscillator: once, whatever the plant."""
    theory, claim = theory_of(integrator), numerics.declared(integrator)
    gain = (numerics.linear_map(integrator, Z).spectral_radius ** 2 - 1.0,)
    factor, bound = undeclared(), undeclared()
    if theory is not None:
        wanted = theory.energy_factor(Z) - 1.0
        factor = near(wanted, _FACTOR_TOLERANCE, gain, why=theory.formula)
        bound = near(theory.oscillation_limit, _LIMIT_TOLERANCE, (limit,))
    elif claim.symplectic:
        factor = near(0.0, _FACTOR_TOLERANCE, gain, why="declared symplectic")
    quantity = f"share of energy gained per step at hω = {Z:g}"
    diagnosis.add(integrator, quantity, gain, "", factor, plant=OSCILLATOR)
    diagnosis.add(integrator, "stable up to hω", (limit,), "", bound, plant=OSCILLATOR)
