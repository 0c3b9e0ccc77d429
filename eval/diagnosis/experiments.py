"""What is played to diagnose: hand-made control, impacts, open-loop controls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.ops.ops import SCALAR, split_state
from integ_gym.envs.registries import TRUTH
from integ_gym.train.baselines.making import has_handmade, make_baseline

from ..verdict import EQUIVALENCE_MARGIN
from .lines import Diagnosis, Expectation, undeclared
from .subject import Subject

TOLERANCE = EQUIVALENCE_MARGIN
"""Success rates this near are the same."""

EPISODES = 20

DEMANDING = {"IntegPendulum-v0": {"start": "hanging", "max_torque": 0.8}}
"""Arguments that leave the controller little to spare, so that the discretization decides."""

_ROUNDING = 1e-9

Array = npt.NDArray[Any]


def described(env_id: str) -> str:
    """The environment and what is not its default, in words."""
    more = DEMANDING.get(env_id, {})
    changed = ", ".join(f"{name}={value}" for name, value in more.items())
    return f"{env_id}{f' ({changed})' if changed else ''}"


def success(
    diagnosis: Diagnosis, env_id: str, integrator: str, dt: float, latency: float = 0.0
) -> float | None:
    """Share of episodes that succeed; None where the task has no hand-made controller.

    Args:
        diagnosis: where it is run.
        env_id: the environment.
        integrator: a registered name or ``"module:Class"``.
        dt: integration step, s.
        latency: of every command, s.
    """
    arguments: dict[str, Any] = {
        **DEMANDING.get(env_id, {}),
        "integrator": integrator,
        "dt": dt,
        "control_period": diagnosis.subject.control_period,
        "action_latency": latency,
    }
    setup = environment_setup(env_id, arguments)
    if not has_handmade(setup):
        return None
    cell = f"{diagnosis.section}/handmade/{integrator}/dt={dt:g}/latency={latency:g}"
    policy = make_baseline("handmade", setup)
    rollout = diagnosis.bench.task(cell, env_id, policy, EPISODES, **arguments)
    return float(rollout.success.mean())


def success_lines(
    diagnosis: Diagnosis,
    env_id: str,
    quantity: str,
    truths: Sequence[tuple[float, float]],
    cases: Sequence[tuple[float, float]],
    steps: tuple[float, ...],
) -> None:
    """Lines on every integrator's success rates against the truth's, if there is a controller.

    Args:
        diagnosis: gets the lines.
        env_id: the environment.
        quantity: what succeeds, in words.
        truths: step and latency of the truth, s, one for each case or one for all.
        cases: step and latency of each rate, s.
        steps: integration steps that are named, s.
    """
    wanted = [success(diagnosis, env_id, TRUTH, *case) for case in truths]
    if None in wanted:
        return
    rates = [rate or 0.0 for rate in wanted] * (len(cases) // len(wanted))
    said = list(dict.fromkeys(f"{rate:.2f}" for rate in rates))
    words = said[0] if len(said) == 1 else ", ".join(f"{rate:.2f}" for rate in rates)
    for integrator in diagnosis.integrators:
        if integrator == TRUTH:
            continue
        shares = [success(diagnosis, env_id, integrator, *case) or 0.0 for case in cases]
        expectation = Expectation(
            f"{words}: as on the truth",
            f"±{TOLERANCE:g}",
            all(abs(a - b) <= TOLERANCE + _ROUNDING for a, b in zip(rates, shares, strict=True)),
        )
        if not any((*rates, *shares)):
            expectation = undeclared("nothing: nobody succeeds, on the truth neither")
        diagnosis.add(
            integrator, f"{quantity}, {described(env_id)}", shares, "", expectation, steps=steps
        )


SPEED = 1.0
"""Speed of arrival, m/s or rad/s."""

LIMIT = 2.0
"""Where the stop stands, m or rad."""

_FREE = 1e-9
"""Acceleration that is none, m/s^2 or rad/s^2."""

PHASES = 16
"""Places within a step at which the stop is touched."""


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

    @property
    def energy(self) -> float:
        """Kinetic energy of arrival, J."""
        return 0.5 * self.mass * SPEED**2

    @property
    def stiffness_unit(self) -> str:
        """Of the stop."""
        return "N m/rad" if self.unit == "rad" else "N/m"

    def starts(self, dt: float, run_up: float, phases: int = PHASES) -> Array:
        """Starts that touch the stop at evenly spaced places within a step, shape (phases, n).

        Args:
            dt: step, s.
            run_up: time before the first touch, at least, s.
            phases: how many.
        """
        starts = np.tile(self.touching, (phases, 1))
        starts[:, self.place] -= SPEED * (run_up + dt * (np.arange(phases) + 0.5) / phases)
        return starts

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
        if d == 0.0:
            return 0.5 * speed * speed
        return speed / d - math.log1p(d * speed) / (d * d)


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
    place = 2 * plant.stopped
    touching = np.zeros(len(subject.rest))
    # A pole along the track is not swung by the cart.
    turned = [i for i, unit in enumerate(plant.coordinate_units) if unit == "rad"]
    touching[[2 * i for i in turned]] = 0.5 * math.pi
    touching[place], touching[place + 1] = LIMIT, SPEED
    free, mass = _response(subject.varied(**arguments), touching, plant.stopped)
    if abs(free) > _FREE:
        return None
    return Impact(
        arguments, touching, place, plant.coordinate_units[plant.stopped], mass,
        plant.stop_stiffness, plant.stop_damping,
    )  # fmt: skip


def _response(plant: Any, state: Array, coordinate: int) -> tuple[float, float]:
    """Acceleration along a coordinate without a force, and force per acceleration."""
    q, v = split_state(tuple(state.tolist()))
    nothing = (0.0,) * len(q)
    unit = tuple(1.0 if i == coordinate else 0.0 for i in range(len(q)))
    pushed, free = (
        plant.acceleration(SCALAR, q, v, force)[coordinate] for force in (unit, nothing)
    )
    return float(free), float(1.0 / (pushed - free))
