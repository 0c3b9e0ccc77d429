"""Steps of exactly one size under a constant generalized force, by Drake's own means."""

from __future__ import annotations

from math import nan
from typing import Any

from .._stepping import Run
from .simulator import SPAN, Clock, Log, force_setter, state_size


def discrete_steps(plant: Any, count: int, speeds: bool = False) -> Run:
    """Updates of a discrete plant; NaN where its solver fails.

    With ``speeds``, each velocity's mean square over the ends of the updates comes last.
    """
    context, end = plant.CreateDefaultContext(), plant.AllocateDiscreteVariables()
    put, size = force_setter(plant, context), state_size(plant)
    update, state = plant.CalcForcedDiscreteVariableUpdate, end.get_value(0)  # a view
    log, lost = Log(count, size), (nan,) * (size + speeds * size // 2)

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
    clock = Clock(plant, scheme, dt)
    context = clock.simulator.get_mutable_context()
    put, size = force_setter(plant, context), state_size(plant)
    end = context.get_continuous_state_vector().get_value()
    log, lost = Log(count, size), (*(nan,) * (size + speeds * size // 2), 0, 0.0, True)
    there: tuple[float, ...] = ()

    def run(*values: float) -> tuple[float, ...]:
        nonlocal there
        put(values[size:])
        if values[:size] != there:
            context.SetContinuousState(values[:size])
        taken = 0
        try:
            while taken < count:
                if clock.now == SPAN:
                    clock.set_back()
                steps = 1 if speeds else min(count - taken, SPAN - clock.now)
                clock.take(steps)
                if speeds:
                    log.rows[taken] = end
                taken += steps
        except RuntimeError:
            there = ()
            return lost
        there = tuple(end.tolist())
        return (*there, *(log.mean_squares() if speeds else ()), 0, 0.0, True)

    return run
