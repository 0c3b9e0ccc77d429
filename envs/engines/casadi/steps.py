"""CasADi's integrators as functions of floats: (*state, control) to (*state, *report).

A report is (iterations, residual, converged). Each takes one step of ``dt`` seconds of the
equations ``dae``, a dictionary as `casadi.integrator` takes it with state x, control p and ode.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stderr
from io import StringIO
from math import nan
from typing import Any

import numpy as np

from integ_gym.support import load

from .._rigid import Array
from .._stepping import Run

TOLERANCE = 1e-12
"""Of Newton's defect and correction, and of the local error of an adaptive integrator."""

NEWTON_CAP = 50
"""Most Newton iterations per step."""

INNER_CAP = 5000
"""Most inner steps of an adaptive integrator per step."""

_ONE_ELEMENT = {"number_of_finite_elements": 1}
"""CasADi divides a step in 20 by default."""


def runge_kutta(dae: dict[str, Any], dt: float) -> Run:
    """The explicit method `rk`: there is nothing to report."""
    start, end = _arrays(dae)
    step = _Bound(_integrator("rk", dae, dt, _ONE_ELEMENT), x0=start[:-1], p=start[-1:], xf=end)

    def run(*values: float) -> tuple[Any, ...]:
        start[:] = values
        step.call()
        return (*end.tolist(), 0, 0.0, True)

    return run


def collocation(dae: dict[str, Any], dt: float, scheme: str, order: int) -> Run:
    """Collocation at the points of a scheme, `legendre` or `radau`.

    The integrator takes a step by one call of its function `step`, Newton's method on the equations
    of its function `implicit_step`. Those two are called here, for the integrator itself keeps
    Newton's report to itself and raises where it fails. The residual is the largest defect of an
    equation, scaled by the component that it is solved for; a step that Newton's method leaves
    above the tolerance only by rounding counts as converged.
    """
    options = {
        **_ONE_ELEMENT,
        "collocation_scheme": scheme,
        "interpolation_order": order,
        "rootfinder_options": {
            "abstol": TOLERANCE,
            "abstolStep": TOLERANCE,
            "max_iter": NEWTON_CAP,
            "error_on_fail": False,
            "show_eval_warnings": False,
        },
    }
    integrator = _integrator("collocation", dae, dt, options)
    start, end = _arrays(dae)
    state, (guess, stages, defect) = start[:-1], np.zeros((3, order, len(end)))
    given = {"h": np.array([dt]), "x0": state, "p": start[-1:]}
    newton = _Bound(integrator.get_function("step"), **given, v00=guess, xf=end, v0=stages)
    test = _Bound(integrator.get_function("implicit_step"), **given, v0=stages, vf=defect)

    def run(*values: float) -> tuple[Any, ...]:
        start[:] = values
        guess[:] = state
        newton.call()
        test.call()
        told = newton.told()
        residual = float((abs(defect) / (1.0 + abs(stages))).max())
        solved = told["success"] or residual <= TOLERANCE
        return (*end.tolist(), told["iter_count"], residual, solved)

    return run


def adaptive(dae: dict[str, Any], dt: float, plugin: str) -> Run:
    """SUNDIALS' `cvodes` or `idas`: iterations are inner steps; the residual is not told and is 0.

    Where it gives up there is no state: components are NaN. `idas` then writes to `sys.stderr`,
    whatever `disable_internal_warnings` says, so that this is turned away during the call.
    """
    options = {
        "abstol": TOLERANCE,
        "reltol": TOLERANCE,
        "max_num_steps": INNER_CAP,
        "disable_internal_warnings": True,
        "show_eval_warnings": False,
    }
    start, end = _arrays(dae)
    step = _Bound(_integrator(plugin, dae, dt, options), x0=start[:-1], p=start[-1:], xf=end)
    lost = (*[nan] * len(end), INNER_CAP, 0.0, False)

    def run(*values: float) -> tuple[Any, ...]:
        start[:] = values
        try:
            with redirect_stderr(StringIO()):
                step.call()
        except RuntimeError:
            return lost
        return (*end.tolist(), step.told()["nsteps"], 0.0, True)

    return run


def _integrator(plugin: str, dae: dict[str, Any], dt: float, options: dict[str, Any]) -> Any:
    return load("casadi", "casadi").integrator("step", plugin, dae, 0.0, dt, options)


def _arrays(dae: dict[str, Any]) -> tuple[Array, Array]:
    """State and control, and state after the step."""
    size = dae["x"].numel()
    return np.zeros(size + 1), np.zeros(size)


class _Bound:
    """A CasADi function that reads and writes these arrays when called.

    Args:
        function: whose inputs and outputs are columns.
        arrays: by name of the input or output; an input that is not named is zero.
    """

    def __init__(self, function: Any, **arrays: Array) -> None:
        self._arrays = arrays
        self._buffer, self.call = function.buffer()
        inputs = function.name_in()
        for name, array in arrays.items():
            if name in inputs:
                self._buffer.set_arg(function.index_in(name), array.data)
            else:
                self._buffer.set_res(function.index_out(name), array.data)

    def told(self) -> Mapping[str, Any]:
        """Statistics of the last call."""
        return self._buffer.stats()  # type: ignore[no-any-return]
