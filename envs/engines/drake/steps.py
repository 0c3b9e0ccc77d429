"""Steps of exactly one size under a constant generalized force, by Drake's own means."""

from __future__ import annotations

from collections.abc import Callable
from math import frexp, ldexp, nan
from typing import Any

import numpy as np

from integ_gym.support.packages.extras import load

from ...arithmetic.ops import Components
from .._stepping.foreign import Run

SPAN = 64
"""Steps on either side of time zero that a clock counts before it is set back."""

_BITS = 47
"""Of a step's size, so that multiples of it up to :data:`SPAN` have 53 at most."""


class Clock:
    """Lets a simulator of a continuous plant take steps of exactly one size.

    A simulator advances to a time, and a step is the difference from the last. The size is ``dt``
    to 47 bits, and times are multiples of it from -64 to 64 and again: all of them and their
    differences are exact, so that no step depends on the time at which it is taken.

    Args:
        plant: continuous.
        scheme: Drake's name of an integrator.
        dt: s.
        least_share: of a step, into which Drake may divide it before it gives up.

    Attributes:
        size: of a step, s.
        simulator: Drake's.
        integrator: Drake's.
        now: number of the last step; at :data:`SPAN` the clock has to be set back.
    """

    def __init__(self, plant: Any, scheme: str, dt: float, least_share: float = 0.0) -> None:
        analysis = load("pydrake.systems.analysis", "drake")
        mantissa, exponent = frexp(dt)
        self.size = ldexp(round(ldexp(mantissa, _BITS)), exponent - _BITS)
        self.simulator = analysis.Simulator(plant)
        self.integrator = analysis.ResetIntegratorFromFlags(self.simulator, scheme, self.size)
        self._quiet = analysis.InitializeParams(suppress_initialization_events=True)
        self._advance, self._least, self.now = self.simulator.AdvanceTo, least_share, SPAN
        self._reset()

    def forget(self) -> None:
        """Let nothing of earlier steps have a part in the next: no matrix outlives a reset."""
        self._reset()
        self.integrator.Initialize()

    def set_back(self) -> None:
        """To the earliest time, and forget."""
        self._reset()
        self.simulator.get_mutable_context().SetTime(-SPAN * self.size)
        self.simulator.Initialize(self._quiet)
        self.now = -SPAN

    def take(self, count: int) -> None:
        """Take steps, to :data:`SPAN` at most; one that fails leaves a clock to be set back."""
        self.now, aim = SPAN, self.now + count
        self._advance(aim * self.size)
        self.now = aim

    def _reset(self) -> None:
        self.integrator.Reset()
        self.integrator.set_fixed_step_mode(True)
        self.integrator.set_maximum_step_size(self.size)
        self.integrator.set_requested_minimum_step_size(self._least * self.size)


class Log:
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


def state_size(plant: Any) -> int:
    """Number of positions and velocities."""
    return 2 * int(plant.num_velocities())


def force_setter(plant: Any, context: Any) -> Callable[[Components], None]:
    """What puts a generalized force into a context."""
    port = plant.get_applied_generalized_force_input_port()
    announce = port.FixValue(context, (0.0,) * plant.num_velocities()).GetMutableData
    held = announce().get_mutable_value().get_mutable_value()

    def put(force: Components) -> None:
        announce()
        held[:] = force

    return put


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
