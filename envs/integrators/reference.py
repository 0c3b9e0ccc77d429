"""The reference solution: the plant solved to rounding over one step, by Dormand-Prince 8(5,3)."""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter, mul
from typing import Any, ClassVar, TypeAlias

from ..ops.ops import Component, Components, Ops, select
from .interface import UNLIMITED, LinearTheory, Step, System
from .newton import time_of_kink

Row: TypeAlias = tuple[tuple[int, float], ...]
Weighted: TypeAlias = tuple[Callable[[list[Component]], Any], tuple[float, ...]]

STAGES: tuple[Row, ...] = (
    ((0, 0.05260015195876773),),
    ((0, 0.0197250569845379), (1, 0.0591751709536137)),
    ((0, 0.02958758547680685), (2, 0.08876275643042054)),
    ((0, 0.2413651341592667), (2, -0.8845494793282861), (3, 0.924834003261792)),
    ((0, 0.037037037037037035), (3, 0.17082860872947386), (4, 0.12546768756682242)),
    ((0, 0.037109375), (3, 0.17025221101954405), (4, 0.06021653898045596), (5, -0.017578125)),
    (
        (0, 0.03709200011850479),
        (3, 0.17038392571223998),
        (4, 0.10726203044637328),
        (5, -0.015319437748624402),
        (6, 0.008273789163814023),
    ),
    (
        (0, 0.6241109587160757),
        (3, -3.3608926294469414),
        (4, -0.868219346841726),
        (5, 27.59209969944671),
        (6, 20.154067550477894),
        (7, -43.48988418106996),
    ),
    (
        (0, 0.47766253643826434),
        (3, -2.4881146199716677),
        (4, -0.590290826836843),
        (5, 21.230051448181193),
        (6, 15.279233632882423),
        (7, -33.28821096898486),
        (8, -0.020331201708508627),
    ),
    (
        (0, -0.9371424300859873),
        (3, 5.186372428844064),
        (4, 1.0914373489967295),
        (5, -8.149787010746927),
        (6, -18.52006565999696),
        (7, 22.739487099350505),
        (8, 2.4936055526796523),
        (9, -3.0467644718982196),
    ),
    (
        (0, 2.273310147516538),
        (3, -10.53449546673725),
        (4, -2.0008720582248625),
        (5, -17.9589318631188),
        (6, 27.94888452941996),
        (7, -2.8589982771350235),
        (8, -8.87285693353063),
        (9, 12.360567175794303),
        (10, 0.6433927460157636),
    ),
)
"""Of each stage but the first."""
END = (
    (0, 0.054293734116568765, 0.01312004499419488, -0.18980075407240762),
    (5, 4.450312892752409, -1.2251564463762044, 4.450312892752409),
    (6, 1.8915178993145003, -0.4957589496572502, 1.8915178993145003),
    (7, -5.801203960010585, 1.6643771824549864, -5.801203960010585),
    (8, 0.3111643669578199, -0.35032884874997366, -0.4226823213237919),
    (9, -0.1521609496625161, 0.3341791187130175, -0.1521609496625161),
    (10, 0.20136540080403034, 0.08192320648511571, 0.20136540080403034),
    (11, 0.04471061572777259, -0.022355307863886294, 0.02265179219836082),
)
"""Of stages, their weights in the eighth-order solution, and in its differences from the embedded
solutions of orders five and three."""


def _prepare_row(row: Row) -> Weighted:
    """A row as (what picks its stages from a list of all, their weights)."""
    stages, weights = zip(*row, strict=True)
    pick = itemgetter(*stages) if len(stages) > 1 else itemgetter(slice(stages[0], stages[0] + 1))
    return pick, weights


_STAGES = tuple([_prepare_row(row) for row in STAGES])
_WEIGHTS, _ERROR_5, _ERROR_3 = (
    _prepare_row(tuple((row[0], row[order]) for row in END)) for order in (1, 2, 3)
)


def trial_step(
    ops: Ops,
    derivative: Callable[[Components], Components],
    y: Components,
    moving: int,
    h: Component,
    tolerance: float,
) -> tuple[Components, Component]:
    """One inner step of size ``h``: the new state and its error in units of the tolerance.

    ``derivative`` takes the first ``moving`` components of the state, on which all others depend
    but nothing depends on them, and gives the slopes of all.
    """
    slopes = [[slope] for slope in derivative(y[:moving])]
    for row in _STAGES:
        point = derivative(_combine(y[:moving], h, row, slopes))
        for known, slope in zip(slopes, point, strict=True):
            known.append(slope)
    end = _combine(y, h, _WEIGHTS, slopes)
    zero = tuple([0.0 * a for a in y])
    fifth = _norm(ops, _combine(zero, h, _ERROR_5, slopes), y, end, tolerance)
    third = _norm(ops, _combine(zero, h, _ERROR_3, slopes), y, end, tolerance)
    scale = ops.sqrt(fifth * fifth + 0.01 * third * third)
    return end, fifth * fifth / ops.maximum(scale, 1e-30)


def _combine(
    y: Components, h: Component, row: Weighted, slopes: list[list[Component]]
) -> Components:
    """``y + h Σ weight · slope`` for as many components as ``y`` has."""
    pick, weights = row
    return tuple([a + h * sum(map(mul, weights, pick(k))) for a, k in zip(y, slopes, strict=False)])


def _norm(
    ops: Ops, error: Components, y: Components, end: Components, tolerance: float
) -> Component:
    largest = 0.0 * error[0]
    for e, a, b in zip(error, y, end, strict=True):
        largest = ops.maximum(largest, abs(e) / (1.0 + ops.maximum(abs(a), abs(b))))
    return largest / tolerance


_SMALLEST = 1e-13
"""Inner steps below this share of ``dt`` mean that the motion cannot be followed."""


class Reference:
    """Dormand-Prince 8(5,3) with its own adaptive steps inside ``dt``, per lane.

    Local error per inner step below 3e-13 (1 + |y|) in float64, so that the result does not depend
    on ``dt`` beyond rounding. Where the system has kinks, only an inner step of 1.5e-8 ``dt`` goes
    across one, and those before are aimed at the first; a step that may have touched one and turned
    back is taken again in parts. Not symplectic by construction; its energy error is rounding.
    ``iterations`` counts inner steps, accepted or not; a step that needs more than the cap is
    reported as not converged.
    Source: Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*, 2nd ed., II.5
    and II.10.
    """

    order: ClassVar[int] = 8
    symplectic: ClassVar[bool] = False
    reversible: ClassVar[bool] = False
    theory: ClassVar[LinearTheory] = LinearTheory("the exact motion", UNLIMITED, UNLIMITED)
    solver_tolerance: ClassVar[float] = 3e-13
    solver_cap: ClassVar[int] = 5000

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
        n = len(q)
        start = (*q, *v, *losses)
        size = len(start)
        tolerance = max(self.solver_tolerance, 16.0 * ops.epsilon)
        shortest = ops.epsilon**0.5 * dt

        def derivative(y: Components) -> Components:
            acceleration, loss_rates = system.rates(ops, y[:n], y[n:], control)
            return (*y[n:], *acceleration, *loss_rates)

        def unfinished(carry: tuple[Component, ...]) -> Component:
            remaining, trial, attempts = carry[size : size + 3]
            return (remaining > 0.0) & (trial > _SMALLEST * dt) & (attempts < self.solver_cap)

        def attempt(carry: tuple[Component, ...]) -> tuple[Component, ...]:
            y, remaining, trial, attempts, worst = carry[:size], *carry[size:]
            h = ops.minimum(trial, remaining)
            end, error = trial_step(ops, derivative, y, 2 * n, h, tolerance)
            accepted = error <= 1.0
            following = h * _growth(ops, error)
            if system.kinked:
                look = time_of_kink(ops, system, n, y, end, control, h)
                early = (look >= 0.0) & (h > shortest)
                accepted = accepted & ops.where(early, False, True)
                nearer = ops.maximum(look - 0.5 * shortest, shortest)
                following = ops.where(early, nearer, following)
            y = select(ops, accepted, end, y)
            remaining = ops.where(accepted, remaining - h, remaining)
            worst = ops.where(accepted, ops.maximum(worst, error * tolerance), worst)
            return (*y, remaining, following, attempts + 1, worst)

        end = ops.while_loop(unfinished, attempt, (*start, dt, dt, 0, 0.0 * dt))
        return Step(
            end[:n], end[n : 2 * n], end[2 * n : size], end[size + 2], end[size + 3],
            end[size] <= 0.0,
        )  # fmt: skip


def _growth(ops: Ops, error: Component) -> Component:
    """Step-size factor of HNW II.4.13, with a non-finite error treated as a large one."""
    usable = ops.where(ops.isfinite(error), ops.maximum(error, 1e-10), 1e10)
    eighth_root = ops.sqrt(ops.sqrt(ops.sqrt(usable)))
    return ops.minimum(5.0, ops.maximum(0.2, 0.9 / eighth_root))
