"""Steps of Drake's implicit integrators, each of which depends on nothing but its beginning.

Drake goes on from step to step with the Jacobian and the factorized iteration matrices that it has
until Newton's method fails with them, so that a step depends on those before, if only within the
method's tolerance. Here all steps begin with the same matrices, those of the plant at rest; where
these take more evaluations of the derivatives, each step makes its own.
"""

from __future__ import annotations

from math import nan, pi
from typing import Any

import numpy as np

from ...arithmetic.ops import Components
from .._stepping.foreign import Run, is_astray
from .steps import SPAN, Clock, Log, force_setter, state_size

ACCURACY = 1e-12
"""Target accuracy of the implicit integrators, on which their Newton iterations stop."""

_LEAST_SHARE = 1.0 / 128.0
"""Of a step, into which Drake may divide it before it gives up."""

_TRIALS = 16
"""Random states from which steps are tried, to see which matrices take fewer evaluations."""

_ITERATIONS = "integrator_num_integrator_newton_raphson_iterations"
"""Of the result itself, without those of the error estimate."""

_DIVISIONS = "integrator_num_step_shrinkages_from_substep_failures"
_FACTORIZATIONS = "integrator_num_iteration_matrix_factorizations"


def implicit_steps(
    plant: Any, scheme: str, dt: float, count: int, from_rest: bool, speeds: bool = False
) -> Run:
    """Steps of an implicit integrator, with the most Newton iterations of any.

    A step that Drake divides is told as not converged. From values that are astray there is no
    step, for on some of them Drake crashes. Steps begin with the matrices at rest where
    ``from_rest`` says so. With ``speeds``, each velocity's mean square over the ends of the steps
    comes before the report.
    """
    stepper, size = Stepper(plant, scheme, dt, from_rest), state_size(plant)
    log, lost = Log(count, size), (*(nan,) * (size + speeds * size // 2), 0, 0.0, False)

    def run(*values: float) -> tuple[float, ...]:
        if is_astray(values):
            return lost
        state, force, most, whole = values[:size], values[size:], 0, True
        try:
            for k in range(count):
                state, iterations, divisions = stepper.step(state, force)
                if is_astray(state):
                    return lost
                if speeds:
                    log.rows[k] = state
                most, whole = max(most, iterations), whole and not divisions
        except RuntimeError:
            return lost
        return (*state, *(log.mean_squares() if speeds else ()), most, 0.0, whole)

    return run


def rest_serves(plant: Any, scheme: str, dt: float) -> bool:
    """Whether steps from many states take fewer evaluations with the matrices at rest."""
    size = state_size(plant)
    states = np.random.default_rng(0).uniform(-pi, pi, (_TRIALS, size)).tolist()
    spent = {True: 0, False: 0}
    for from_rest in spent:
        stepper = Stepper(plant, scheme, dt, from_rest)
        for state in states:
            try:
                stepper.step(tuple(state), (0.0,) * (size // 2))
            except RuntimeError:
                return False
            if stepper.spoiled and from_rest:
                return False
            spent[from_rest] += stepper.evaluations
    return spent[True] < spent[False]


class Stepper:
    """Takes single steps, each of which depends on its beginning alone.

    Args:
        plant: continuous.
        scheme: Drake's name of an implicit integrator.
        dt: s.
        from_rest: whether steps begin with the matrices at rest, or with none.

    Attributes:
        spoiled: whether the last step has left other matrices than it began with.
    """

    def __init__(self, plant: Any, scheme: str, dt: float, from_rest: bool) -> None:
        self._clock = Clock(plant, scheme, dt, _LEAST_SHARE)
        self._context = self._clock.simulator.get_mutable_context()
        self._put = force_setter(plant, self._context)
        self._end = self._context.get_continuous_state_vector().get_value()
        self._integrator, self._from_rest = self._clock.integrator, from_rest
        self._integrator.set_target_accuracy(ACCURACY)
        self._prepare = self._integrator.ResetStatistics if from_rest else self._clock.forget
        self._statistics = self._integrator.GetStatisticsSummary
        names = [name for name, _ in self._statistics()]
        told = (_ITERATIONS, _DIVISIONS, _FACTORIZATIONS)
        self._iterations, self._divisions, self._factorizations = map(names.index, told)
        self._at_rest = (0.0,) * len(self._end), (0.0,) * (len(self._end) // 2)
        self._state: Components = ()
        self._force: Components = ()
        self.spoiled = False

    @property
    def evaluations(self) -> int:
        """Of the derivatives, in the last step."""
        return int(self._integrator.get_num_derivative_evaluations())

    def step(self, state: Components, force: Components) -> tuple[Components, int, int]:
        """The state after a step, Newton's iterations, and how often Drake divided the step.

        Parts of a step are rounded with the time at which they are taken: a step that Drake divides
        or gives up is done again at a time that is always the same.

        Raises:
            RuntimeError: where Drake gives up.
        """
        try:
            told = self._attempted(state, force)
            whole = not told[self._divisions][1]
        except RuntimeError:
            whole = False
        if not whole:
            self._clock.now = SPAN
            told = self._attempted(state, force)
        return self._state, told[self._iterations][1], told[self._divisions][1]

    def _attempted(self, state: Components, force: Components) -> Any:
        """Take a step; what the integrator tells of it."""
        if self._clock.now == SPAN or (self.spoiled and self._from_rest):
            self._begin()
        self._prepare()
        self._take(state, force)
        told = self._statistics()
        self.spoiled = told[self._factorizations][1] > 0
        return told

    def _begin(self) -> None:
        """Set the clock back, without matrices; make those at rest."""
        self._clock.set_back()
        if self._from_rest:
            self._take(*self._at_rest)

    def _take(self, state: Components, force: Components) -> None:
        if state != self._state:
            self._context.SetContinuousState(state)
        if force != self._force:
            self._put(force)
        self._state, self._force = (), force
        self._clock.take(1)
        self._state = tuple(self._end.tolist())
