"""Steps of exactly one size under a constant generalized force, by Drake's own means."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import nan
from typing import Any

import numpy as np

from integ_gym.envs.engines._foreign import Run, is_astray
from integ_gym.envs.extras import load
from integ_gym.envs.ops import Components

ACCURACY = 1e-12
"""Target accuracy of the implicit integrators, on which their Newton iterations stop."""

_ITERATIONS = "integrator_num_integrator_newton_raphson_iterations"
"""Of the result itself, without those of the error estimate."""

_DIVISIONS = "integrator_num_step_shrinkages_from_substep_failures"

_LEAST_SHARE = 1.0 / 128.0
"""Of a step, into which Drake may divide it before it gives up."""


def discrete_steps(plant: Any, count: int, speeds: bool = False) -> Run:
    """Updates of a discrete plant; NaN where its solver fails.

    With ``speeds``, each velocity's mean square over the ends of the updates comes last.
    """
    context, end = plant.CreateDefaultContext(), plant.AllocateDiscreteVariables()
    put, size = _force_setter(plant, context), _state_size(plant)
    update, state = plant.CalcForcedDiscreteVariableUpdate, end.get_value(0)  # a view
    log, lost = _Log(count, size), (nan,) * (size + speeds * size // 2)

    def run(*values: float) -> tuple[float, ...]:
        put(values[size:])
        context.SetDiscreteState(0, values[:size])
        try:
            for k in range(count):
                if k:
                    context.SetDiscreteState(0, state)
                update(context, end)
                if speeds:
                    log.rows[k] = state
        except RuntimeError:
            return lost
        return (*state.tolist(), *(log.mean_squares() if speeds else ()))

    return run


def explicit_steps(plant: Any, scheme: str, dt: float, count: int, speeds: bool = False) -> Run:
    """Steps of an explicit integrator, with the report of one that solves nothing.

    A state that is there is not set again. With ``speeds``, each velocity's mean square over the
    ends of the steps comes before the report.
    """
    simulator = _simulator(plant, scheme, dt)
    context, (take, _) = simulator.get_mutable_context(), _taker(simulator, dt)
    put, size = _force_setter(plant, context), _state_size(plant)
    end = context.get_continuous_state_vector().get_value()
    log, lost = _Log(count, size), (*(nan,) * (size + speeds * size // 2), 0, 0.0, True)
    there: tuple[float, ...] = ()

    def run(*values: float) -> tuple[float, ...]:
        nonlocal there
        put(values[size:])
        if values[:size] != there:
            context.SetContinuousState(values[:size])
        try:
            if speeds:
                for k in range(count):
                    take(1)
                    log.rows[k] = end
            else:
                take(count)
        except RuntimeError:
            there = ()
            return lost
        there = tuple(end.tolist())
        return (*there, *(log.mean_squares() if speeds else ()), 0, 0.0, True)

    return run


def implicit_steps(plant: Any, scheme: str, dt: float, count: int, speeds: bool = False) -> Run:
    """Steps of an implicit integrator, with the most Newton iterations of any.

    Each begins anew, so that no Jacobian of an earlier one has a part in its result. Where Newton's
    method fails, Drake divides the step, fixed or not: that is told as not converged, and done
    again at a time that is always the same, on which rounding depends. From values
    that are astray there is no step, for on some of them Drake crashes. A state that is there is
    not set again. With ``speeds``, each velocity's mean square over the ends of the steps comes
    before the report.
    """
    simulator = _simulator(plant, scheme, dt)
    context, (take, rewind) = simulator.get_mutable_context(), _taker(simulator, dt, anew=True)
    put, size = _force_setter(plant, context), _state_size(plant)
    integrator = simulator.get_mutable_integrator()
    integrator.set_target_accuracy(ACCURACY)
    integrator.set_requested_minimum_step_size(_LEAST_SHARE * dt)
    statistics = integrator.GetStatisticsSummary
    end = context.get_continuous_state_vector().get_value()
    names = [name for name, _ in statistics()]
    iterations, divisions = names.index(_ITERATIONS), names.index(_DIVISIONS)
    log, lost = _Log(count, size), (*(nan,) * (size + speeds * size // 2), 0, 0.0, False)
    there: tuple[float, ...] = ()

    def run(*values: float) -> tuple[float, ...]:
        nonlocal there
        if is_astray(values):
            return lost
        put(values[size:])
        if values[:size] != there:
            context.SetContinuousState(values[:size])
        state, there, most, divided = values[:size], (), 0, 0
        try:
            for k in range(count):
                take(1)
                told = statistics()
                if told[divisions][1]:
                    context.SetContinuousState(state)
                    rewind()
                    take(1)
                    told = statistics()
                state = tuple(end.tolist())
                if is_astray(state):
                    return lost
                if speeds:
                    log.rows[k] = state
                most = max(most, told[iterations][1])
                divided += told[divisions][1]
        except RuntimeError:
            return lost
        there = state
        return (*state, *(log.mean_squares() if speeds else ()), most, 0.0, divided == 0)

    return run


class _Log:
    """States at the ends of steps.

    Attributes:
        rows: shape (steps, positions and velocities).
    """

    def __init__(self, count: int, size: int) -> None:
        self.rows = np.empty((count, size))
        self._velocities = self.rows.T[size // 2 :]

    def mean_squares(self) -> list[float]:
        """Of each velocity."""
        return [float(x.dot(x)) / len(x) for x in self._velocities]


def _state_size(plant: Any) -> int:
    """Number of positions and velocities."""
    return 2 * int(plant.num_velocities())


def _simulator(plant: Any, scheme: str, dt: float) -> Any:
    """A simulator whose integrator takes steps of ``dt``."""
    analysis = load("pydrake.systems.analysis", "drake")
    simulator = analysis.Simulator(plant)
    integrator = analysis.ResetIntegratorFromFlags(simulator, scheme, dt)
    integrator.set_fixed_step_mode(True)
    integrator.set_maximum_step_size(dt)
    return simulator


def _taker(
    simulator: Any, dt: float, anew: bool = False
) -> tuple[Callable[[int], None], Callable[[], None]]:
    """What takes a number of steps of exactly ``dt``, and what goes back to the earliest time.

    With ``anew``, each step begins without memory.

    A simulator advances to a time, and a step is the difference from the last: times are taken
    between which the difference is ``dt`` to the last bit, from -2 dt to 2 dt and again.
    """
    analysis = load("pydrake.systems.analysis", "drake")
    quiet = analysis.InitializeParams(suppress_initialization_events=True)
    start, advance = partial(simulator.Initialize, quiet), simulator.AdvanceTo
    context, now = simulator.get_mutable_context(), 2
    begin_anew, most = simulator.get_mutable_integrator().Initialize, 1 if anew else 4

    def take(count: int) -> None:
        nonlocal now
        while count:
            if now == 2:
                context.SetTime(-2.0 * dt)
                start()
                now = -2
            if anew:
                begin_anew()
            steps = min(count, most, 2 - now)
            now, aim = 2, now + steps
            advance(aim * dt)
            now = aim
            count -= steps

    def rewind() -> None:
        nonlocal now
        now = 2

    return take, rewind


def _force_setter(plant: Any, context: Any) -> Callable[[Components], None]:
    """What puts a generalized force into a context."""
    port = plant.get_applied_generalized_force_input_port()
    announce = port.FixValue(context, (0.0,) * plant.num_velocities()).GetMutableData
    held = announce().get_mutable_value().get_mutable_value()

    def put(force: Components) -> None:
        announce()
        held[:] = force

    return put
