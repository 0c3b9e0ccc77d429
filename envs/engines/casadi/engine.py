"""CasADi."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan
from typing import Any, ClassVar

from integ_gym.support import load

from ...arithmetic import Component, Components, Ops
from ...integrators import Step
from ...mechanics import PlantSystem
from .._stepping import MappedEngine, Run, guarded
from . import steps


class CasadiEngine(MappedEngine):
    """CasADi's integrators over the plant's own equations, in float64, interpreted by CasADi.

    The equations are told to CasADi once, friction, stops and losses included, so that all act
    within the integrator's stages. Every plant will do whose equations are made of the operations
    of :class:`integ_gym.envs.arithmetic.ops.Ops` but `while_loop` and `foreign`. `rk` and
    `collocation` take one finite element per step. `cvodes` and `idas` choose inner steps of their
    own, to a local error of 1e-12: at steps of interest tens to hundreds of them, so that they
    agree with the reference to about 1e-10 per step.

    Raises:
        TypeError: for equations that CasADi cannot be told.
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

    def __init__(self, system: PlantSystem, integrator: str, dt: float) -> None:
        super().__init__(system, integrator, dt)
        size = 2 * len(system.plant.coordinates) + len(system.no_losses)
        self._truths = (*[False] * size, False, False, True)
        lost = (*[nan] * size, 0, 0.0, False)
        self._step = guarded(_stepper(_equations(system), integrator, dt), lost)
        if integrator != "rk":
            self.solver_tolerance = steps.TOLERANCE
            self.solver_cap = steps.INNER_CAP if self.map == "reference" else steps.NEWTON_CAP

    def move(
        self, ops: Ops, q: Components, v: Components, losses: Components, control: Component
    ) -> Step:
        """One of CasADi's steps."""
        n = len(q)
        flat = ops.foreign(self._step, (*q, *v, *losses, control), self._truths)
        return Step(flat[:n], flat[n : 2 * n], flat[2 * n : -3], *flat[-3:])


def _stepper(dae: dict[str, Any], integrator: str, dt: float) -> Run:
    if integrator == "rk":
        return steps.runge_kutta(dae, dt)
    if integrator in ("cvodes", "idas"):
        return steps.adaptive(dae, dt, integrator)
    _, scheme, order = integrator.split("_")
    return steps.collocation(dae, dt, scheme, int(order))


def _equations(system: PlantSystem) -> dict[str, Any]:
    """(q, v, losses)' as CasADi's expression of (q, v, losses) and the control."""
    casadi = load("casadi", "casadi")
    from .ops import CasadiOps, Expression, plain

    n = len(system.plant.coordinates)
    state = casadi.SX.sym("state", 2 * n + len(system.no_losses))
    control = casadi.SX.sym("control")
    q, v = (tuple([Expression(state[i]) for i in range(k, k + n)]) for k in (0, n))
    acceleration, losses = system.rates(CasadiOps(), q, v, Expression(control))
    slopes = [plain(x) for x in (*v, *acceleration, *losses)]
    return {"x": state, "p": control, "ode": casadi.vertcat(*slopes)}
