"""One-step maps that engines apply beside our own integrators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

from ..integrators.implicit import ImplicitEuler
from ..integrators.interface import State, Step, System
from ..integrators.newton import Solved, differences, solve, solve_linear
from ..mechanics import Slopes
from ..ops.ops import Component, Components, Ops, along
from ..plants.system import PlantSystem
from ..registries import INTEGRATORS, MAPS, TRUTH

Row = tuple[float, ...]


class Tableau(NamedTuple):
    """Coefficients of a method; the nodes are not needed, for a control is held in a step."""

    stages: tuple[Row, ...]
    """a: weights of the slopes of all stages, one row per stage; explicit rows end early."""
    weights: Row
    """b: weights of the slopes at the end."""


class RungeKutta:
    """What a method is made of; neither symplectic nor reversible where it does not say so."""

    symplectic: ClassVar[bool] = False
    reversible: ClassVar[bool] = False
    tableau: ClassVar[Tableau]


class ExplicitRungeKutta(RungeKutta):
    """A method each of whose stages needs only those before; losses take the same weights."""

    def step(
        self,
        ops: Ops,
        system: System,
        q: Components,
        v: Components,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Step:
        speeds: list[Components] = []
        accelerations: list[Components] = []
        powers: list[Components] = []
        for row in self.tableau.stages:
            speed = along_row(v, dt, row, accelerations)
            acceleration, power = system.rates(ops, along_row(q, dt, row, speeds), speed, control)
            speeds.append(speed)
            accelerations.append(acceleration)
            powers.append(power)
        weights = self.tableau.weights
        return Step(
            along_row(q, dt, weights, speeds),
            along_row(v, dt, weights, accelerations),
            along_row(losses, dt, weights, powers),
        )


class ImplicitRungeKutta(RungeKutta, Solved):
    """A method whose stages are solved for together by Newton's method.

    The unknowns are the velocities of all stages, from those at the start of the step. Losses take
    the same weights.
    """

    def step(
        self,
        ops: Ops,
        system: System,
        q: Components,
        v: Components,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Step:
        rows, weights = self.tableau
        equation = _StageEquation(ops, system, q, v, control, dt, rows)
        velocities, *report = solve(equation, v * len(rows), self)
        accelerations, powers = zip(*equation.rates(velocities), strict=True)
        speeds = [along_row(v, dt, row, accelerations) for row in rows]
        return Step(
            along_row(q, dt, weights, speeds),
            along_row(v, dt, weights, accelerations),
            along_row(losses, dt, weights, powers),
            *report,
        )


class _StageEquation(NamedTuple):
    """F_i(V) = V_i - v - h Σ_j a_ij a(Q_j, V_j) with Q_j = q + h Σ_k a_jk V_k, stage by stage."""

    ops: Ops
    system: System
    q: Components
    v: Components
    control: Components
    h: Component
    rows: tuple[Row, ...]

    def points(self, velocity: Components) -> list[tuple[Components, Components]]:
        """(Q, V) of each stage."""
        n = len(self.v)
        speeds = [velocity[i * n : (i + 1) * n] for i in range(len(self.rows))]
        positions = [along_row(self.q, self.h, row, speeds) for row in self.rows]
        return list(zip(positions, speeds, strict=True))

    def rates(self, velocity: Components) -> list[tuple[Components, Components]]:
        """Accelerations and the rates of the losses, of each stage."""
        return [
            self.system.rates(self.ops, position, speed, self.control)
            for position, speed in self.points(velocity)
        ]

    def defect(self, velocity: Components) -> Components:
        accelerations = [acceleration for acceleration, _ in self.rates(velocity)]
        target: Components = ()
        for row in self.rows:
            target = (*target, *along_row(self.v, self.h, row, accelerations))
        return tuple([x - y for x, y in zip(velocity, target, strict=True)])

    def derivative(self, velocity: Components, f: Components) -> tuple[Components, ...]:
        """Rows of ∂F/∂V at ``velocity``, where F is ``f``."""
        slopes = []
        for position, speed in self.points(velocity):
            known = self.system.slopes(self.ops, position, speed, self.control)
            if known is None:
                return differences(self, velocity, f)
            slopes.append(known)
        places = [(i, x) for i in range(len(self.rows)) for x in range(len(self.v))]
        return tuple(tuple(self._slope(slopes, *of, *by) for by in places) for of in places)

    def _slope(self, slopes: Sequence[Slopes], i: int, x: int, k: int, y: int) -> Component:
        """∂F/∂V for component x of stage i by component y of stage k."""
        a, h = self.rows, self.h
        by_speed = a[i][k] * slopes[k][1][x][y]
        by_position = sum(a[i][j] * a[j][k] * by_q[x][y] for j, (by_q, _) in enumerate(slopes))
        return (1.0 if (i, x) == (k, y) else 0.0) - h * (by_speed + h * by_position)


def along_row(x: Components, h: Component, row: Row, slopes: Sequence[Components]) -> Components:
    """``x + h Σ weight · slope``."""
    used = [(weight, slope) for weight, slope in zip(row, slopes, strict=False) if weight]
    if not used:
        return x
    return tuple(
        [a + h * sum(weight * slope[i] for weight, slope in used) for i, a in enumerate(x)]
    )


class LinearlyImplicit:
    """Kick implicitly in some of the forces, then drift; losses by the rates of the end.

    The kick is Δv with (I - h ∂a/∂v) Δv = h a.
    """

    order: ClassVar[int] = 1
    losses_of: ClassVar[str] = "end"
    """End of the step whose rates of loss, times the step, are its losses."""

    slopes: Callable[..., tuple[Components, ...]]
    """(ops, system, q, v, control) to ∂a/∂v by the forces that are taken implicitly."""

    def step(
        self,
        ops: Ops,
        system: PlantSystem,
        q: Components,
        v: Components,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Step:
        acceleration, _ = system.rates(ops, q, v, control)
        matrix = [
            tuple((1.0 if i == j else 0.0) - dt * slope for j, slope in enumerate(row))
            for i, row in enumerate(self.slopes(ops, system, q, v, control))
        ]
        v = along(v, dt, solve_linear(ops, tuple(matrix), acceleration))
        q = along(q, dt, v)
        _, loss_rates = system.rates(ops, q, v, control)
        return Step(q, v, along(losses, dt, loss_rates))


def damping_slopes(
    ops: Ops, system: PlantSystem, q: Components, v: Components
) -> tuple[Components, ...]:
    """∂a/∂v by the plant's viscous damping alone, -M⁻¹D with a diagonal D."""
    plant = system.plant
    none = (0.0,) * len(v)
    free = plant.acceleration(ops, q, none, none)
    columns = []
    for j in range(len(v)):
        unit = (*none[:j], 1.0, *none[j + 1 :])
        drag = (*none[:j], -plant.dissipation(ops, q, unit), *none[j + 1 :])
        slowed = plant.acceleration(ops, q, none, drag)
        columns.append([a - b for a, b in zip(slowed, free, strict=True)])
    return tuple(zip(*columns, strict=True))


class Heun(ExplicitRungeKutta):
    """Slopes at the start and at the end of an explicit Euler step, averaged.

    Order 2; not symplectic, not reversible. Also called the explicit trapezoidal rule.
    Source: Heun (1900); Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*,
    2nd ed., table II.1.1.
    """

    order: ClassVar[int] = 2
    tableau: ClassVar[Tableau] = Tableau(((), (1.0,)), (0.5, 0.5))


class Kutta3(ExplicitRungeKutta):
    """Slopes at the start, in the middle and at the end, with the weights of Simpson's rule.

    Order 3; not symplectic, not reversible.
    Source: Kutta (1901), *Beitrag zur näherungsweisen Integration totaler Differentialgleichungen*,
    Zeitschrift für Mathematik und Physik 46.
    """

    order: ClassVar[int] = 3
    tableau: ClassVar[Tableau] = Tableau(
        ((), (0.5,), (-1.0, 2.0)), (1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0)
    )


class BogackiShampine3(ExplicitRungeKutta):
    """The third-order half of the 3(2) pair, at a fixed step.

    Order 3; not symplectic, not reversible. Its stages are Ralston's; the fourth of the pair serves
    the error estimate alone.
    Source: Bogacki and Shampine (1989), *A 3(2) pair of Runge-Kutta formulas*, Applied Mathematics
    Letters 2.
    """

    order: ClassVar[int] = 3
    tableau: ClassVar[Tableau] = Tableau(
        ((), (0.5,), (0.0, 0.75)), (2.0 / 9.0, 1.0 / 3.0, 4.0 / 9.0)
    )


class DormandPrince5(ExplicitRungeKutta):
    """The fifth-order half of the 5(4) pair, at a fixed step.

    Order 5; not symplectic, not reversible. The seventh stage of the pair serves the error estimate
    alone. Known as DOPRI5, RK45 and ode45.
    Source: Dormand and Prince (1980); Hairer, Nørsett and Wanner, *Solving Ordinary Differential
    Equations I*, 2nd ed., table II.5.2.
    """

    order: ClassVar[int] = 5
    tableau: ClassVar[Tableau] = Tableau(
        (
            (),
            (1 / 5,),
            (3 / 40, 9 / 40),
            (44 / 45, -56 / 15, 32 / 9),
            (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
            (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
        ),
        (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
    )


_S = 3.0**0.5 / 6.0


class GaussLegendre4(ImplicitRungeKutta):
    """Collocation at the two Gauss points of the step, symmetric about its middle.

    Order 4, A-stable, reversible; symplectic where the mass matrix is constant. Conserves quadratic
    invariants. The one-stage method of the family is the implicit midpoint rule.
    Source: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., II.1.3 and VI.4.
    """

    order: ClassVar[int] = 4
    symplectic: ClassVar[bool] = True
    reversible: ClassVar[bool] = True
    tableau: ClassVar[Tableau] = Tableau(((0.25, 0.25 - _S), (0.25 + _S, 0.25)), (0.5, 0.5))


class RadauIIA3(ImplicitRungeKutta):
    """Collocation at one third and at the end of the step.

    Order 3, L-stable; not symplectic, not reversible: it drains energy slowly. The one-stage
    method of the family is implicit Euler.
    Source: Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd ed., table IV.5.5.
    """

    order: ClassVar[int] = 3
    tableau: ClassVar[Tableau] = Tableau(((5 / 12, -1 / 12), (3 / 4, 1 / 4)), (3 / 4, 1 / 4))

    def losses_between(
        self,
        ops: Ops,
        system: System,
        start: State,
        end: State,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Components:
        """``losses`` after a step of this map of which both ends are known.

        The end is its second stage, and from the two the slope of the first follows.
        """
        (q, v), (end_q, end_v) = start, end
        row, weights = self.tableau.stages
        last, last_powers = system.rates(ops, end_q, end_v, control)
        changes = [(b - a) / dt for a, b in zip(v, end_v, strict=True)]
        pairs = zip(changes, last, strict=True)
        first = tuple([(mean - weights[1] * a) / weights[0] for mean, a in pairs])
        speeds = along_row(v, dt, row, (first, last))
        _, powers = system.rates(ops, along_row(q, dt, row, (speeds, end_v)), speeds, control)
        return along_row(losses, dt, weights, (powers, last_powers))


_R = 6.0**0.5
_LAST = ((16.0 - _R) / 36.0, (16.0 + _R) / 36.0, 1.0 / 9.0)


class RadauIIA5(ImplicitRungeKutta):
    """Collocation at two points within the step and at its end.

    Order 5, L-stable; not symplectic, not reversible: it drains energy very slowly. At a fixed
    step, unlike the program RADAU5, which chooses its steps.
    Source: Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd ed., table IV.5.6.
    """

    order: ClassVar[int] = 5
    tableau: ClassVar[Tableau] = Tableau(
        (
            ((88.0 - 7.0 * _R) / 360.0, (296.0 - 169.0 * _R) / 1800.0, (3.0 * _R - 2.0) / 225.0),
            ((296.0 + 169.0 * _R) / 1800.0, (88.0 + 7.0 * _R) / 360.0, -(2.0 + 3.0 * _R) / 225.0),
            _LAST,
        ),
        _LAST,
    )


class ImplicitEulerHalfSteps:
    """Implicit Euler at half the step, twice.

    Order 1, L-stable; not symplectic, not reversible. What integrators do that estimate their error
    by step doubling and go on from the finer result. Iterations are those of both half steps.
    Source: Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*, 2nd ed., II.4,
    on step doubling.
    """

    order: ClassVar[int] = 1
    symplectic: ClassVar[bool] = False
    reversible: ClassVar[bool] = False
    solver_tolerance: ClassVar[float] = ImplicitEuler.solver_tolerance
    solver_cap: ClassVar[int] = 2 * ImplicitEuler.solver_cap

    def step(
        self,
        ops: Ops,
        system: System,
        q: Components,
        v: Components,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Step:
        half, method = 0.5 * dt, ImplicitEuler()
        first = method.step(ops, system, q, v, losses, control, half)
        second = method.step(ops, system, first.q, first.v, first.losses, control, half)
        return second._replace(
            iterations=first.iterations + second.iterations,
            residual=ops.maximum(first.residual, second.residual),
            converged=first.converged & second.converged,
        )

    def losses_between(
        self,
        ops: Ops,
        system: System,
        start: State,
        end: State,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Components:
        """``losses`` after a step of this map of which both ends are known.

        Its middle is a half step of explicit Euler back from the end.
        """
        half, (end_q, end_v) = 0.5 * dt, end
        slopes, powers = system.rates(ops, end_q, end_v, control)
        middle_q, middle_v = along(end_q, -half, end_v), along(end_v, -half, slopes)
        _, middle_powers = system.rates(ops, middle_q, middle_v, control)
        return along(along(losses, half, middle_powers), half, powers)


class SymplecticEulerImplicitDamping(LinearlyImplicit):
    r"""Kick with the damping of the end, then drift.

    .. math:: (M + hD)(v_1 - v_0) = h M a(q_0, v_0), \qquad q_1 = q_0 + h v_1

    Order 1. Without damping it is symplectic Euler. Energy lost to damping: the damping force of
    the end times the displacement.
    Source: MuJoCo's documentation, *Computation: Numerical integration*, "Euler".
    """

    def slopes(
        self, ops: Ops, system: PlantSystem, q: Components, v: Components, control: Components
    ) -> tuple[Components, ...]:
        return damping_slopes(ops, system, q, v)


class SymplecticEulerImplicitVelocity(LinearlyImplicit):
    r"""Kick with the velocity-dependent forces of the end to first order, then drift.

    .. math:: (I - h\,\partial a/\partial v)(v_1 - v_0) = h a(q_0, v_0), \qquad q_1 = q_0 + h v_1

    Order 1. Coriolis and centrifugal terms are among those forces, so that it differs from
    symplectic Euler on a plant whose mass matrix depends on q, also without damping.
    Source: MuJoCo's documentation, *Computation: Numerical integration*, "implicit".
    """

    def slopes(
        self, ops: Ops, system: PlantSystem, q: Components, v: Components, control: Components
    ) -> tuple[Components, ...]:
        """∂a/∂v; the differences are exact, for accelerations are quadratic in the velocity."""
        columns = []
        for j, x in enumerate(v):
            above, _ = system.rates(ops, q, (*v[:j], x + 0.5, *v[j + 1 :]), control)
            below, _ = system.rates(ops, q, (*v[:j], x - 0.5, *v[j + 1 :]), control)
            columns.append([a - b for a, b in zip(above, below, strict=True)])
        return tuple(zip(*columns, strict=True))


class SymplecticEulerSequentialDamping:
    r"""Kick without damping, then ten times: damp each joint implicitly, and drift a tenth.

    .. math:: w = v_0 + h \left(a(q_0, v_0) + M^{-1} D v_0\right)

    and in each part of length :math:`p = h/10`, for the joints j in turn,

    .. math:: w \leftarrow w - M^{-1} e_j \frac{p\,d_j w_j}{1 + p\,d_j\,(M^{-1})_{jj}}

    and then :math:`q \leftarrow q + p\,w`, with M of :math:`q_0` throughout. Order 1. Without
    damping it is symplectic Euler. Energy lost to damping: in each part, the damping force of its
    end times its displacement.
    Source: the temporal Gauss-Seidel solver of NVIDIA's PhysX 5, articulation joint drives; found
    by measurement. Its parts: Macklin et al. (2019), *Small steps in physics simulation*.
    """

    order: ClassVar[int] = 1
    parts: ClassVar[int] = 10

    def step(
        self,
        ops: Ops,
        system: PlantSystem,
        q: Components,
        v: Components,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Step:
        acceleration, _ = system.rates(ops, q, v, control)
        slopes = damping_slopes(ops, system, q, v)
        kicked = along(v, dt, acceleration)
        w = tuple(
            x - dt * sum(slope * y for slope, y in zip(row, v, strict=True))
            for x, row in zip(kicked, slopes, strict=True)
        )
        part = dt / self.parts
        columns = tuple(zip(*slopes, strict=True))
        for _ in range(self.parts):
            for j, column in enumerate(columns):
                w = along(w, part * w[j] / (1.0 - part * column[j]), column)
            q = along(q, part, w)
            _, loss_rates = system.rates(ops, q, w, control)
            losses = along(losses, part, loss_rates)
        return Step(q, w, losses)


def one_step_map(name: str) -> Any:
    """The map or integrator of that name, an object with a ``step`` as integrators have it.

    Raises:
        ValueError: for an unknown name.
    """
    registry = INTEGRATORS if name in INTEGRATORS else MAPS
    return registry.load(name)()


def map_names() -> tuple[str, ...]:
    """Names of all maps that an engine is compared with, ours first; the exact solution is none."""
    return (*(n for n in INTEGRATORS.names() if n != TRUTH), *MAPS.names())
