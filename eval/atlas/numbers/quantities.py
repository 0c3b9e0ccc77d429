"""Dimensionless numbers of a discretization and a task, known before anything is trained."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs import Discretization, numerics

from ...panel import SpecError
from .limits import control_argument, critical_limit, middle_start, setup_of

FINE = 0.05
"""Step times fastest rate at which RK4 has the truth's critical limits: to the last digit of the
search on a pendulum, to 0.5 % on a cart-pole that strikes the ends of its track."""

LEAST_SPARE = 0.05
"""Time to spare that is told where there is less, or none."""

UNREACHED = 1e3
"""Critical ratio of a discretization in which no limit suffices that was tried."""


class Quantities:
    """What a policy's training ground does, beside what the truth does; each found when asked for.

    All but the last three hold for one task and one limit of its control. The motion that numerics
    are held against is the greedy swing-up on the truth, see :func:`numerics.reach`.

    Args:
        env_id: one of integ-gym's environments with a goal at rest.
        environment: constructor arguments without the discretization.
        home: discretization.

    Attributes:
        env_id: of the environment.
        home: discretization.

    Raises:
        SpecError: where the task names no goal at rest, or no single argument limits the control.
        TypeError, ValueError: for arguments that are not possible.
    """

    def __init__(self, env_id: str, environment: Mapping[str, Any], home: Discretization) -> None:
        self.home = home
        self.env_id, self._environment = env_id, dict(environment)
        self._truth = setup_of(env_id, environment, _truth(home.control_period))
        self._there = setup_of(env_id, environment, home)
        self._argument, self._limit = control_argument(self._truth)
        required = numerics.goal_energy(self._truth)
        if required is None:
            raise SpecError(f"{env_id} names no goal at rest, so nothing is known of it")
        self._required = required

    @cached_property
    def margin(self) -> float:
        """Limit of the control over the critical one of the truth.

        Raises:
            SpecError: where the truth cannot reach the goal with any limit that was tried.
        """
        return self._limit / self._critical(self._near_truth)

    @cached_property
    def critical_ratio(self) -> float:
        """Critical limit there over that of the truth."""
        exact = self._critical(self._near_truth)
        try:
            return self._critical(self.home) / exact
        except SpecError:
            return UNREACHED

    @cached_property
    def energy_share(self) -> float:
        """Numerics' share of the energy that a greedy swing-up gains there; negative: drained."""
        found = _swing_up(self._there, middle_start(self._truth), self._required)
        gained = self._required - numerics.energy_at(self._truth, found.states[0])[0]
        return float(np.clip(found.residual[0] / gained, -1.0, 1.0))

    @property
    def force(self) -> float:
        """Of the numerics over the motor's full force, see :class:`numerics.Disturbance`."""
        return self._disturbance.force

    @property
    def power(self) -> float:
        """Of the numerics over the motor's full power; negative where they drain."""
        return self._disturbance.power

    @property
    def reactive_force(self) -> float:
        """The part of the force that takes back what it gives: that which pumps is left out."""
        found = self._disturbance
        return found.force * math.sqrt(1.0 - found.coherence**2)

    @cached_property
    def time_to_spare(self) -> float:
        """Time that is left after a greedy swing-up on the truth and a stay, over what it takes.

        A swing-up that comes too late, or never, leaves `LEAST_SPARE`; none at all, infinity.
        """
        swing_up = float(self._motion.time[0])
        there_is = float(self._truth.settings.duration - self._truth.task.goal_stay)
        return max(there_is / swing_up - 1.0, LEAST_SPARE) if swing_up else math.inf

    @property
    def step(self) -> float:
        """Integration step over the control period."""
        return self.home.dt / self.home.control_period

    @cached_property
    def h_omega(self) -> float:
        """Integration step times the plant's fastest rate."""
        return self.home.dt * numerics.fastest_rate(self._truth.plant)

    @property
    def inverse_order(self) -> float:
        """One over the order of the method."""
        return 1.0 / (numerics.declared(self.home.integrator).order or np.inf)

    @property
    def growth(self) -> float:
        """Spectral radius of its map of the oscillator at `h_omega`, less 1."""
        return numerics.linear_map(self.home.integrator, self.h_omega).spectral_radius - 1.0

    @cached_property
    def _near_truth(self) -> Discretization:
        """A tenth of the truth's cost, where much is searched for."""
        period = self.home.control_period
        steps = math.ceil(period * numerics.fastest_rate(self._truth.plant) / FINE)
        return Discretization("rk4", period / steps, period)

    @cached_property
    def _disturbance(self) -> numerics.Disturbance:
        states, controls = self._motion.states[:-1, 0], self._motion.controls[:, 0]
        return numerics.disturbance(self._truth, self._there, states, controls)

    @property
    def _motion(self) -> numerics.Reach:
        given = tuple(sorted(self._environment.items()))
        return _motion(self.env_id, given, self.home.control_period)

    def _critical(self, at: Discretization) -> float:
        return critical_limit(self.env_id, self._environment, self._argument, at)


def _truth(control_period: float) -> Discretization:
    return Discretization("reference", control_period, control_period)


@lru_cache(maxsize=256)
def _motion(
    env_id: str, given: tuple[tuple[str, Any], ...], control_period: float
) -> numerics.Reach:
    """The greedy swing-up on the truth, which all discretizations of a task are held against."""
    setup = setup_of(env_id, dict(given), _truth(control_period))
    required = numerics.goal_energy(setup)
    assert required is not None
    return _swing_up(setup, middle_start(setup), required)


def _swing_up(setup: Any, start: npt.NDArray[np.float64], required: float) -> numerics.Reach:
    return numerics.reach(setup, start[None], setup.settings.duration, required)
