"""Runge-Kutta methods made of their Butcher tableaux."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

from ...arithmetic.ops import Component, Components, Ops
from ...integrators._solving.newton import Solved, differences, solve
from ...integrators.interface import Step, System

Row = tuple[float, ...]
Slopes = tuple[tuple[Components, ...], tuple[Components, ...]]


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
        control: Component,
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
        control: Component,
        dt: Component,
    ) -> Step:
        rows, weights = self.tableau
        equation = _StageEquation(ops, system, q, v, control, dt, rows)
        velocities, *report = solve(ops, equation, v * len(rows), system.steep)
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
    control: Component
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
                return differences(self.ops, self, velocity, f)
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
