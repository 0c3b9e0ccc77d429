"""Contact: penetration, rebound and ledger of one impact, over step and stiffness."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from integ_gym.envs.ops.ops import SCALAR, join_state, split_state
from integ_gym.envs.registries import TRUTH

from .bench import Rollout
from .lines import NO_CONTROL, Diagnosis, Expectation, amount, near, undeclared
from .subject import Array, Subject, theory_of

SPEED = 1.0
"""Speed of arrival, m/s or rad/s."""

LIMIT = 2.0
"""Where the stop stands, m or rad."""

PHASES = 16
"""Places within a step at which the stop is touched."""

HALVINGS, STIFFNESSES, MAP_PHASES = 6, 13, 4
"""Steps of the map from the coarsest, its stiffnesses, and touches for each pair of them."""

RANGE = (0.25, 16.0)
"""hω of the mass on the stop at the coarsest step, from the softest to the stiffest stop."""

GAIN = 1e-6
"""Energy above this share of the impact's is gained: no passive stop gives any."""

SMALL = 0.02
"""hω of the mass on the stop at which the order of its ledger shows."""

PARTS = 4
"""Decisions in the time of a contact, at least: the ledger's residuals are added up over them."""

KINK = (2, "the force sets in with a kink")
"""Largest order of a step in which that happens."""

TOLERANCE = 0.05
"""Rebound energy as a share, and penetration relative to the exact one, this near are right."""

_NEWTON_STEPS = 20
"""In which a point is brought onto its plane."""

_FREE = 1e-9
"""Acceleration that is none, m/s^2 or rad/s^2."""

_UNSTRETCHED = 1e-9
"""Energy of springs that is none, J."""


def sweep_approach(touching: Array, dt: float, run_up: float, phases: int) -> Array:
    """Starts from which a state is reached at evenly spaced places within a step.

    Args:
        touching: a state of free motion, state order, shape (n,).
        dt: step, s.
        run_up: time before it is reached, at least, s.
        phases: how many.

    Returns:
        Shape (phases, n).
    """
    starts = np.tile(touching, (phases, 1))
    before = run_up + dt * (np.arange(phases) + 0.5) / phases
    starts[:, 0::2] -= np.outer(before, touching[1::2])
    return starts


@dataclass(frozen=True)
class Impact:
    """An impact without gravity and without anything that swings.

    Attributes:
        arguments: plant parameters but the stiffness.
        touching: state in which the stop is touched, state order, shape (n,).
        place: of the stopped coordinate in the state.
        unit: of the stopped coordinate.
        mass: that meets the stop, kg or kg m^2.
        stiffness: of the plant's stop by default, N/m or N m/rad.
        damping: of the stop, s/m or s/rad.
    """

    arguments: dict[str, Any]
    touching: Array
    place: int
    unit: str
    mass: float
    stiffness: float
    damping: float

    def rate(self, stiffness: float) -> float:
        """Frequency of the mass on the stop, rad/s."""
        return math.sqrt(stiffness / self.mass)

    def penetration(self, stiffness: float) -> float:
        """How deep the mass goes in, m or rad."""
        return math.sqrt(2.0 * self._spent(SPEED)) / self.rate(stiffness)

    @property
    def rebound(self) -> float:
        """Share of the kinetic energy that is left, whatever the stiffness."""
        low, high = 0.0, SPEED
        for _ in range(100):
            middle = 0.5 * (low + high)
            below = self.damping * middle < 1.0 and self._spent(-middle) < self._spent(SPEED)
            low, high = (middle, high) if below else (low, middle)
        return (low / SPEED) ** 2

    def _spent(self, speed: float) -> float:
        """g(speed), m^2/s^2."""
        d = self.damping
        return speed / d - math.log1p(d * speed) / (d * d) if d else 0.5 * speed * speed


def impact_of(subject: Subject) -> Impact | None:
    """The impact of a plant on its stop; None without stops, or where other forces act there."""
    plant: Any = subject.plant
    limits = subject.parameters("limit")
    described = all(hasattr(plant, n) for n in ("stopped", "stop_stiffness", "stop_damping"))
    if not described or len(limits) != 1:
        return None
    arguments = {limits[0]: LIMIT, **subject.undamped}
    if hasattr(plant, "gravity"):
        arguments["gravity"] = 0.0
    touching = np.zeros(len(subject.rest))
    # A pole along the track is not swung by the cart.
    touching[0::2] = [0.5 * math.pi if unit == "rad" else 0.0 for unit in plant.coordinate_units]
    place = 2 * plant.stopped
    touching[place], touching[place + 1] = LIMIT, SPEED
    q, v = split_state(tuple(touching.tolist()))
    forces = np.zeros((2, len(q)))
    forces[1, plant.stopped] = 1.0
    free, pushed = (
        subject.varied(**arguments).acceleration(SCALAR, q, v, tuple(force))[plant.stopped]
        for force in forces.tolist()
    )
    if abs(free) > _FREE:
        return None
    return Impact(
        arguments, touching, place, plant.coordinate_units[plant.stopped],
        float(1.0 / (pushed - free)), plant.stop_stiffness, plant.stop_damping,
    )  # fmt: skip


def diagnose_contact(diagnosis: Diagnosis) -> None:
    """Let the plant run into its stop, at many steps and stiffnesses, and onto its planes."""
    impact = impact_of(diagnosis.subject)
    if impact is not None:
        for integrator in diagnosis.integrators:
            _add_default(diagnosis, integrator, impact)
            if integrator != TRUTH:
                _add_map(diagnosis, integrator, impact)
    for name in getattr(diagnosis.subject.plant, "contact_names", ()):
        _add_landing(diagnosis, name)


@dataclass(frozen=True)
class Landing:
    """A contact point that comes onto its plane without gravity, moved by a force on it alone.

    Attributes:
        arguments: plant parameters.
        touching: state in which the plane is touched, state order, shape (n,).
        rate: frequency of the plant on the plane, rad/s.
    """

    arguments: dict[str, Any]
    touching: Array
    rate: float


def find_landing(subject: Subject, name: str) -> Landing | None:
    """The landing of a contact point, near the subject's start or its mirror image.

    Springs of the plant are at rest, and the plant is moved to the plane by coordinates that leave
    them so, where there are any.

    Args:
        subject: the plant.
        name: of the point.

    Returns:
        None where other points are beyond their planes then.
    """
    plant: Any = subject.plant
    arguments = {"gravity": 0.0} if hasattr(plant, "gravity") else {}
    light: Any = subject.varied(**arguments)
    place = plant.contact_names.index(name)
    contact = light.contacts[place]
    others = light.contacts[:place] + light.contacts[place + 1 :]
    still = (0.0,) * len(plant.coordinates)

    def energy(q: Array) -> float:
        return float(light.energy(SCALAR, tuple(q.tolist()), still))

    for start in (subject.start[0::2], -subject.start[0::2]):
        q = minimize(energy, start, tol=_UNSTRETCHED).x
        loose = np.array([energy(q + one) - energy(q) < _UNSTRETCHED for one in np.eye(len(q))])
        for _ in range(_NEWTON_STEPS):
            configuration = tuple(q.tolist())
            frame = contact.frame(SCALAR, configuration)
            normal = np.array(frame.normal, dtype=np.float64)
            mass = np.array(light.mass_matrix(SCALAR, configuration), dtype=np.float64)
            pushed = np.linalg.pinv(mass) @ normal
            moved = normal * loose if (normal * loose).any() else pushed
            q = q - frame.gap * moved / (normal @ moved)
        if all(other.frame(SCALAR, configuration).gap > 0.0 for other in others):
            v = -SPEED * pushed / (normal @ pushed)
            rate = math.sqrt(contact.stiffness * float(normal @ pushed))
            return Landing(arguments, np.array(join_state(tuple(q), tuple(v))), rate)
    return None


def _add_landing(diagnosis: Diagnosis, name: str) -> None:
    """Landings everywhere within a step against the truth: penetration, loss, and the ledger."""
    subject, landing = diagnosis.subject, find_landing(diagnosis.subject, name)
    if landing is None:
        return
    fine = subject.ladder(landing.rate, SMALL)[-1]
    period = subject.control_period
    starts = sweep_approach(landing.touching, period, period, PHASES)

    def land(integrator: str, dt: float) -> Rollout:
        period = subject.choose_sampling_interval(dt, math.pi / landing.rate / PARTS)
        duration = 2.0 * subject.control_period + 1.5 * math.pi / landing.rate
        return diagnosis.bench.run_open_loop(
            f"{diagnosis.section}/{name}/{integrator}/dt={dt:g}", subject, integrator, dt,
            ("zero", NO_CONTROL), starts, control_period=period,
            duration=math.ceil(duration / period) * period, **landing.arguments,
        )  # fmt: skip

    def measures(rollout: Rollout) -> tuple[float, float]:
        return float(penetration(rollout).max()), float(rollout.so_far("contact_loss")[-1].max())

    truth, title = land(TRUTH, fine), f"{name} lands"
    for integrator in diagnosis.integrators:
        if integrator == TRUTH:
            diagnosis.add_ledger(integrator, {fine: truth}, title)
            continue
        rollouts = [land(integrator, dt) for dt in subject.steps]
        found = zip(*map(measures, rollouts), strict=True)
        words = ("largest penetration", "m"), ("most energy that the plane takes", "J")
        for (quantity, unit), measured, exact in zip(words, found, measures(truth), strict=True):
            expectation = undeclared("nothing: the truth diverges")
            if math.isfinite(exact):
                expectation = near(exact, TOLERANCE * exact, measured, unit, "as on the truth")
            diagnosis.add(
                integrator, f"{title}, {quantity} of {PHASES} touches", measured, unit,
                expectation, steps=subject.steps,
            )  # fmt: skip
        diagnosis.add(
            integrator, f"{title}, Σ |energy residual|, mean of {PHASES}",
            [float(r.residual().mean()) for r in rollouts], "J",
            undeclared("nothing: friction turns within a step"), steps=subject.steps,
        )  # fmt: skip


def _strike(
    diagnosis: Diagnosis,
    integrator: str,
    impact: Impact,
    dt: float,
    stiffness: Array,
    phases: int,
    period: float,
) -> Rollout:
    """Lanes of every stiffness, one after the other in every phase; a period is a decision's."""
    subject = diagnosis.subject
    run_up = subject.control_period
    slowest = impact.rate(float(stiffness.min()))
    duration = math.ceil((4.0 * run_up + 1.5 * math.pi / slowest) / period) * period
    touches = sweep_approach(impact.touching, dt, run_up, phases)
    starts = np.repeat(touches, len(stiffness), axis=0)
    return diagnosis.bench.run_open_loop(
        f"{diagnosis.section}/{len(stiffness)}/{integrator}/dt={dt:g}", subject, integrator, dt,
        ("zero", NO_CONTROL), starts, control_period=period, duration=duration,
        stop_stiffness=np.tile(stiffness, phases), **impact.arguments,
    )  # fmt: skip


def rebound(rollout: Rollout) -> Array:
    """Energy after the impact as a share of that before, shape (lanes,); inf where it diverged."""
    start, end = rollout.info["energy"][0], rollout.info["energy"][-1]
    return np.asarray(np.where(np.isfinite(end), end / start, np.inf))


def penetration(rollout: Rollout) -> Array:
    """Deepest penetration, m or rad, shape (lanes,); inf where it diverged."""
    deepest = np.nanmax(rollout.info["penetration"], axis=0)
    return np.asarray(np.where(rollout.diverged(), np.inf, deepest))


def _add_default(diagnosis: Diagnosis, integrator: str, impact: Impact) -> None:
    """At the plant's own stiffness, touched everywhere within a step."""
    subject, stiffness = diagnosis.subject, np.array([impact.stiffness])
    rate = impact.rate(impact.stiffness)
    steps = subject.ladder(rate, SMALL)
    if integrator == TRUTH:
        steps = steps[-1:]
    rollouts = {
        dt: _strike(
            diagnosis, integrator, impact, dt, stiffness, PHASES,
            subject.choose_sampling_interval(dt, math.pi / rate / PARTS),
        )
        for dt in steps
    }  # fmt: skip
    own_steps = steps if integrator == TRUTH else subject.steps
    own = [rollouts[dt] for dt in own_steps]
    shares = [rebound(r) for r in own]
    left = [float(x[np.argmax(np.abs(x - impact.rebound))]) for x in shares]
    deep = [float(penetration(r).max()) for r in own]
    exact = impact.penetration(impact.stiffness)
    tolerance = 1e-6 if integrator == TRUTH else TOLERANCE
    for quantity, measured, wanted, off, unit in (
        (f"share of energy left after the rebound, worst of {PHASES} touches", left,
         impact.rebound, tolerance, ""),
        (f"largest penetration of {PHASES} touches", deep, exact, TOLERANCE * exact, impact.unit),
    ):  # fmt: skip
        expectation = near(wanted, off, measured, unit, "analytic")
        diagnosis.add(integrator, quantity, measured, unit, expectation, steps=own_steps)
    diagnosis.add_ledger(integrator, rollouts, f"mean of {PHASES} touches", at_most=KINK)
    diagnosis.add_solver(integrator, own, steps=own_steps)


def _add_map(diagnosis: Diagnosis, integrator: str, impact: Impact) -> None:
    """The impact over step and stiffness, and where it stops being passive."""
    coarsest = diagnosis.subject.control_period
    rates = np.geomspace(*RANGE, STIFFNESSES) / coarsest
    stiffness = impact.mass * rates**2
    steps = [coarsest / 2**k for k in range(HALVINGS)]
    rollouts = [
        _strike(diagnosis, integrator, impact, dt, stiffness, MAP_PHASES, coarsest) for dt in steps
    ]
    left, deep, residual = (
        np.array(values).reshape(HALVINGS, MAP_PHASES, STIFFNESSES)
        for values in (
            [rebound(r) for r in rollouts],
            [penetration(r) for r in rollouts],
            [r.residual() / (0.5 * impact.mass * SPEED**2) for r in rollouts],
        )
    )
    off = left - impact.rebound
    worst = np.take_along_axis(off, np.abs(off).argmax(axis=1)[:, None], axis=1)[:, 0]
    exact = np.array([impact.penetration(float(k)) for k in stiffness])
    gains = left.max(axis=1) > 1.0 + GAIN
    diagnosis.draw(
        "contact", integrator=integrator, steps=np.array(steps), stiffness=stiffness, rates=rates,
        rebound=worst, penetration=deep.max(axis=1) / exact - 1.0, residual=residual.mean(axis=1),
        gains=gains, unit="N m/rad" if impact.unit == "rad" else "N/m",
    )  # fmt: skip
    limit = float(np.outer(steps, rates)[gains].min(initial=math.inf))
    diagnosis.add(
        integrator,
        f"smallest hω of {HALVINGS} × {STIFFNESSES} steps and stiffnesses at which a rebound "
        "gains energy",
        (limit,), "", passive(integrator, limit),
    )  # fmt: skip


def passive(integrator: str, limit: float) -> Expectation:
    """What is expected of the hω from which an impact gains energy.

    The stop's potential is convex. An explicit step is a polynomial in hω, which outgrows any
    bound: well beyond the limit of an oscillator that is never left, the stop throws back more than
    it got. Damping and the way out move where that begins. No theory says how far: twice the limit,
    and 1 where there is none, are bounds that all built-in methods were seen to keep.
    """
    theory = theory_of(integrator)
    if theory is None:
        return undeclared()
    if theory.passive:
        return Expectation("at none: the potential is convex", "exactly", math.isinf(limit))
    if math.isinf(theory.oscillation_limit):
        return undeclared("no promise: an oscillator never grows")
    bound = 2.0 * theory.oscillation_limit or 1.0
    why = f"an oscillator grows above {amount(theory.oscillation_limit)}"
    return Expectation(why, f"up to {amount(bound)}", limit <= bound)
