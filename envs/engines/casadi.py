"""Components as CasADi expressions: the plant's equations, translated for CasADi."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stderr
from io import StringIO
from math import nan
from typing import Any, ClassVar

import numpy as np

from integ_gym.support.optional import load

from ..integrators.interface import Step
from ..ops.ops import Components, Ops
from ..plants.system import PlantSystem
from ..registries import TRUTH
from .rigid import Array
from .simulator import MappedEngine, Run, guard

NEWTON = {"abstol": 1e-12, "max_iter": 50}
"""Of Newton's defect and correction, and most iterations per step."""

ADAPTIVE = {"abstol": 1e-12, "reltol": 1e-12, "max_num_steps": 5000}
"""Of the local error of an adaptive integrator, and most inner steps per step."""

_ONE_ELEMENT = {"number_of_finite_elements": 1}
"""CasADi divides a step in 20 by default."""


class CasadiEngine(MappedEngine):
    """CasADi's integrators over the plant's own equations, in float64, interpreted by CasADi.

    The equations are translated once, friction, stops and losses included, so that all act
    within the integrator's stages. Every plant will do whose equations are made of the operations
    of :class:`integ_gym.envs.ops.ops.Ops` but `while_loop` and `foreign`. `rk` and
    `collocation` take one finite element per step. `cvodes` and `idas` choose inner steps of their
    own, to a local error of 1e-12: at steps of interest tens to hundreds of them, so that they
    agree with the reference to about 1e-10 per step.

    Raises:
        TypeError: for equations that CasADi cannot express.
    """

    name: ClassVar[str] = "casadi"
    package: ClassVar[str] = "casadi"
    modules: ClassVar[tuple[str, ...]] = ("casadi",)
    reports: bool = True
    maps: ClassVar[Mapping[str, str]] = {
        "rk": "rk4",
        "collocation_legendre_1": "implicit_midpoint",
        "collocation_legendre_2": "gauss_legendre4",
        "collocation_radau_1": "implicit_euler",
        "collocation_radau_2": "radau_iia3",
        "collocation_radau_3": "radau_iia5",
        "cvodes": "reference",
        "idas": "reference",
    }
    solver_defaults: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        name: ADAPTIVE if own == "reference" else NEWTON
        for name, own in maps.items()
        if name != "rk"
    }

    def prepare(self) -> None:
        """Make the integrator's function of the plant's equations."""
        system = self.system
        size = 2 * len(system.plant.coordinates) + len(system.no_losses)
        self._truths = (*[False] * size, False, False, True)
        lost = (*[nan] * size, 0, 0.0, False)
        stepper = _stepper(_equations(system), self.integrator, self.dt, self.settings)
        self._step = guard(stepper, lost)
        if self.settings:
            self.solver_tolerance = self.settings["abstol"]
            cap = "max_num_steps" if self.map == TRUTH else "max_iter"
            self.solver_cap = self.settings[cap]

    def acceleration(self, q: Components, v: Components, force: Components) -> Components:
        """By CasADi's expression of it, with the force of stops and friction."""
        from .casadi_ops import CasadiOps, plain

        system, casadi, n, ops = self.system, load("casadi", "casadi"), len(q), CasadiOps()
        given = casadi.SX.sym("given", 3 * n)
        own_q, own_v, acting = (_expressions(given, k, n) for k in (0, n, 2 * n))
        total = system.with_resistance(ops, own_q, own_v, acting)
        found = [plain(x) for x in system.plant.acceleration(ops, own_q, own_v, total)]
        evaluate = casadi.Function("acceleration", [given], [casadi.vertcat(*found)])
        return tuple(np.array(evaluate([*q, *v, *force])).ravel().tolist())

    def move(
        self, ops: Ops, q: Components, v: Components, losses: Components, control: Components
    ) -> Step:
        """One of CasADi's"""
        n = len(q)
        flat = ops.foreign(self._step, (*q, *v, *losses, *control), self._truths)
        return Step(flat[:n], flat[n : 2 * n], flat[2 * n : -3], *flat[-3:])


def _equations(system: PlantSystem) -> dict[str, Any]:
    """(q, v, losses)' as CasADi's expression of (q, v, losses) and the controls."""
    from .casadi_ops import CasadiOps, plain

    casadi = load("casadi", "casadi")
    n = len(system.plant.coordinates)
    state = casadi.SX.sym("state", 2 * n + len(system.no_losses))
    control = casadi.SX.sym("control", len(system.plant.controls))
    q, v = (_expressions(state, k, n) for k in (0, n))
    controls = _expressions(control, 0, control.numel())
    acceleration, losses = system.rates(CasadiOps(), q, v, controls)
    slopes = [plain(x) for x in (*v, *acceleration, *losses)]
    return {"x": state, "p": control, "ode": casadi.vertcat(*slopes)}


def _expressions(vector: Any, first: int, count: int) -> Components:
    """Entries of a vector of symbols, as our arithmetic takes them."""
    from .casadi_ops import Expression

    return tuple([Expression(vector[i]) for i in range(first, first + count)])


def _stepper(dae: dict[str, Any], integrator: str, dt: float, settings: Mapping[str, Any]) -> Run:
    """An integrator as a function of floats: (*state, *controls) to (*state, *report).

    A report is (iterations, residual, converged). It takes one step of ``dt`` seconds of the
    equations ``dae``, a dictionary as `casadi.integrator` takes it with state x, control p and ode.
    """
    if integrator == "rk":
        return _runge_kutta(dae, dt)
    if integrator in ("cvodes", "idas"):
        return _adaptive(dae, dt, integrator, settings)
    _, scheme, order = integrator.split("_")
    return _collocation(dae, dt, scheme, int(order), settings)


def _runge_kutta(dae: dict[str, Any], dt: float) -> Run:
    """The explicit method `rk`: there is nothing to report."""
    start, end = _arrays(dae)
    given = {"x0": start[: len(end)], "p": start[len(end) :]}
    step = _Bound(_integrator("rk", dae, dt, _ONE_ELEMENT), **given, xf=end)

    def run(*values: float) -> tuple[Any, ...]:
        start[:] = values
        step.call()
        return (*end.tolist(), 0, 0.0, True)

    return run


def _collocation(
    dae: dict[str, Any], dt: float, scheme: str, order: int, settings: Mapping[str, Any]
) -> Run:
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
            **settings,
            "abstolStep": settings["abstol"],
            "error_on_fail": False,
            "show_eval_warnings": False,
        },
    }
    integrator = _integrator("collocation", dae, dt, options)
    start, end = _arrays(dae)
    state, (guess, stages, defect) = start[: len(end)], np.zeros((3, order, len(end)))
    given = {"h": np.array([dt]), "x0": state, "p": start[len(end) :]}
    newton = _Bound(integrator.get_function("step"), **given, v00=guess, xf=end, v0=stages)
    test = _Bound(integrator.get_function("implicit_step"), **given, v0=stages, vf=defect)

    def run(*values: float) -> tuple[Any, ...]:
        start[:] = values
        guess[:] = state
        newton.call()
        test.call()
        statistics = newton.statistics()
        residual = float((abs(defect) / (1.0 + abs(stages))).max())
        solved = statistics["success"] or residual <= settings["abstol"]
        return (*end.tolist(), statistics["iter_count"], residual, solved)

    return run


def _adaptive(dae: dict[str, Any], dt: float, plugin: str, settings: Mapping[str, Any]) -> Run:
    """SUNDIALS' `cvodes` or `idas`: iterations are inner steps; no residual, so it is 0.

    Where it gives up there is no state: components are NaN. `idas` then writes to `sys.stderr`,
    whatever `disable_internal_warnings` says, so that this is turned away during the call.
    """
    options = {
        **settings,
        "disable_internal_warnings": True,
        "show_eval_warnings": False,
    }
    start, end = _arrays(dae)
    given = {"x0": start[: len(end)], "p": start[len(end) :]}
    step = _Bound(_integrator(plugin, dae, dt, options), **given, xf=end)
    lost = (*[nan] * len(end), settings["max_num_steps"], 0.0, False)

    def run(*values: float) -> tuple[Any, ...]:
        start[:] = values
        try:
            with redirect_stderr(StringIO()):
                step.call()
        except RuntimeError:
            return lost
        return (*end.tolist(), step.statistics()["nsteps"], 0.0, True)

    return run


def _integrator(plugin: str, dae: dict[str, Any], dt: float, options: dict[str, Any]) -> Any:
    return load("casadi", "casadi").integrator("step", plugin, dae, 0.0, dt, options)


def _arrays(dae: dict[str, Any]) -> tuple[Array, Array]:
    """State and controls, and state after the step."""
    size = dae["x"].numel()
    return np.zeros(size + dae["p"].numel()), np.zeros(size)


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

    def statistics(self) -> Mapping[str, Any]:
        """Statistics of the last call."""
        return self._buffer.stats()  # type: ignore[no-any-return]
