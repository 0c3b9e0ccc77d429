"""Lines of a diagnosis: what was found, what was expected, and whether it holds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.registries import INTEGRATORS, TRUTH
from integ_gym.support.terminal import compact

from .bench import Bench, Rollout
from .subject import Array, Subject


@dataclass(frozen=True)
class Expectation:
    """One expectation.

    Attributes:
        expected: what is expected, with its unit and, where it is short, the reason.
        tolerance: how far off the measurement may be, with its unit.
        holds: whether it is within; None where nothing is expected.
    """

    expected: str
    tolerance: str
    holds: bool | None


NOTHING = "-"
"""Tolerance where nothing is expected, or where words alone decide."""


def near(
    wanted: float, tolerance: float, measured: Sequence[float], unit: str = "", why: str = ""
) -> Expectation:
    """Every number within a tolerance of one value, infinity included; NaN is not."""
    holds = all(x == wanted or abs(x - wanted) <= tolerance for x in measured)
    off = "exactly" if tolerance == 0.0 or math.isinf(wanted) else f"±{amount(tolerance, unit)}"
    return Expectation(_with_reason(amount(wanted, unit), why), off, holds)


def below(
    bound: float, measured: Sequence[float], unit: str = "", why: str = "rounding"
) -> Expectation:
    """No number as large as a bound; NaN is."""
    holds = all(abs(x) < bound for x in measured)
    return Expectation(_with_reason("0", why), f"below {amount(bound, unit)}", holds)


def above(bound: float, measured: Sequence[float], unit: str = "", why: str = "") -> Expectation:
    """Every number above a bound; what diverged, and so is NaN, is."""
    holds = not any(x <= bound for x in measured)
    return Expectation(why, f"above {amount(bound, unit)}", holds)


def undeclared(why: str = "not declared") -> Expectation:
    """Nothing is promised."""
    return Expectation(why, NOTHING, None)


def format_rounded(value: float) -> str:
    """A number with three significant digits, a whole one as it is; infinity and NaN in words."""
    if math.isnan(value):
        return "diverged"
    if math.isinf(value):
        return "unbounded"
    whole = value == round(value) and abs(value) < 1e4
    return f"{value:z.0f}".replace("-", "−") if whole else compact(value, 3)


def amount(value: float, unit: str = "") -> str:
    """A number that somebody chose, without trailing zeros, with its unit."""
    if not math.isfinite(value):
        return format_rounded(value)
    mantissa, power, exponent = format_rounded(value).partition("·")
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    number = exponent if power and mantissa == "1" else mantissa + power + exponent
    return f"{number} {unit}".strip()


def _with_reason(expected: str, why: str) -> str:
    return f"{expected}: {why}" if why else expected


VERDICTS = {True: "yes", False: "NO", None: "-"}
"""What a table says of `holds`; None: nothing was expected."""


@dataclass(frozen=True)
class Finding:
    """One line.

    Attributes:
        section: part of the diagnosis.
        plant: the plant's name, or its reference.
        integrator: the integrator's name, or its reference; :data:`ANY` where none takes part.
        quantity: what was measured, in words.
        measured: numbers, coarse to fine where ``steps`` has several; NaN: the motion diverged,
            ``inf``: there is no limit.
        unit: SI unit of the numbers.
        expectation: what is expected, the tolerance, and whether it holds.
        steps: integration steps that the numbers belong to, s.
        order: measured order of the numbers in the step, where one was measured; None also where
            there is nothing but rounding, NaN where the motion diverged.
        order_steps: integration steps over which the order was measured, s.
    """

    section: str
    plant: str
    integrator: str
    quantity: str
    measured: tuple[float, ...]
    unit: str
    expectation: Expectation
    steps: tuple[float, ...] = ()
    order: float | None = None
    order_steps: tuple[float, ...] = ()

    @property
    def holds(self) -> bool | None:
        """Whether what is expected holds; None where nothing is."""
        holds = self.expectation.holds
        return None if holds is None else bool(holds)

    def words(self) -> str:
        """The measurement as shown in a table."""
        numbers = ", ".join(map(format_rounded, self.measured))
        unit = f" {self.unit}" if self.unit and any(map(math.isfinite, self.measured)) else ""
        order = ""
        if self.order_steps and self.order is None:
            order = "rounding"
        elif self.order is not None:
            order = f"order {self.order:.2f}" if math.isfinite(self.order) else "diverges"
        return "; ".join(filter(None, (numbers + unit, order)))

    def row(self) -> dict[str, Any]:
        """The line as a table's row; ``shown`` says which numbers are not finite."""
        fields = asdict(self)
        expectation = fields.pop("expectation")
        return {**fields, **expectation, "holds": self.holds, "shown": self.words()}


ANY = "-"
"""Integrator of a line in which none takes part."""


TOLERANCE = 0.1
"""A measured order this far off is another one."""

EXACT = 1e-9
"""Errors of the exact motion are below this share of the scale."""


def order_expected(
    promised: int | None,
    measured: float | None,
    exactly: bool = False,
    at_most: tuple[int, str] | None = None,
) -> Expectation:
    """Whether a measured order is the promised one.

    Args:
        promised: the declared order, or None.
        measured: the slope; None: there is nothing but rounding; NaN: the motion diverged.
        exactly: whether a higher order than promised counts as wrong, too. Energies often converge
            faster than motions.
        at_most: largest order that the motion allows, and why.
    """
    if promised is None:
        return undeclared()
    wanted, why = promised, ""
    if at_most is not None and at_most[0] < promised:
        wanted, why = at_most[0], f": {at_most[1]}"
    if measured is None:
        return undeclared(f"order {wanted}; nothing but rounding at these steps")
    if exactly:
        return Expectation(f"order {wanted}", f"±{TOLERANCE}", abs(measured - wanted) <= TOLERANCE)
    least = wanted - TOLERANCE
    return Expectation(f"order {wanted} or more{why}", f"down to {least:g}", measured >= least)


SCIPY = 1e-11
"""Errors against SciPy's integral below this share of the energy are its own."""

NO_CONTROL = np.zeros((1, 1))


@dataclass
class Diagnosis:
    """One section of a diagnosis on one plant.

    Attributes:
        section: its name.
        bench: where rollouts are run.
        subject: the plant.
        integrators: names or references.
        leads: whether it also says what does not depend on the plant.
        findings: the lines so far.
        curves: what the figures draw, by name of the figure.
        identities: what each integrator is on this plant.
    """

    section: str
    bench: Bench
    subject: Subject
    integrators: tuple[str, ...]
    leads: bool = True
    findings: list[Finding] = field(default_factory=list)
    curves: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    identities: list[dict[str, Any]] = field(default_factory=list)

    def steps(self, integrator: str) -> tuple[float, ...]:
        """Steps to take, coarse to fine, s: the exact motion is the same at every step."""
        return self.subject.steps[:1] if integrator == TRUTH else self.subject.steps

    def ladder(self, integrator: str) -> tuple[float, ...]:
        """The same with the finer steps over which orders are measured."""
        return self.subject.steps[:1] if integrator == TRUTH else self.subject.ladder()

    def follow(
        self,
        integrator: str,
        steps: Sequence[float],
        start: Array,
        values: Array = NO_CONTROL,
        name: str = "",
        **arguments: Any,
    ) -> dict[float, Rollout]:
        """Follow the bare plant from one start at several steps.

        Args:
            integrator: a registered name or ``"module:Class"``.
            steps: s.
            start: state order, shape (n,).
            values: commands, shape (decisions, controls), or (decisions, 1) where all are alike.
            name: tells motions of the section apart.
            arguments: constructor arguments; ``duration`` in s among them.
        """
        named = f"{name}/" if name else ""
        return {
            dt: self.bench.run_open_loop(
                f"{self.section}/{named}{integrator}/dt={dt:g}", self.subject, integrator, dt,
                (name or "zero", values), start[None], **arguments,
            )
            for dt in steps
        }  # fmt: skip

    def add(
        self,
        integrator: str,
        quantity: str,
        measured: Sequence[float],
        unit: str,
        expectation: Expectation,
        plant: str = "",
        **more: Any,
    ) -> None:
        """Add a line; see :class:`Finding` for what follows."""
        self.findings.append(
            Finding(
                self.section, plant or self.subject.name, integrator, quantity,
                tuple(float(x) for x in measured), unit, expectation, **more,
            )
        )  # fmt: skip

    def draw(self, figure: str, **curve: Any) -> None:
        """Keep a curve for a figure."""
        self.curves.setdefault(figure, []).append({"plant": self.subject.name, **curve})

    def add_order(
        self,
        integrator: str,
        quantity: str,
        errors: Mapping[float, float],
        unit: str,
        scale: float,
        exact: str = "rounding",
        rounding: float = numerics.ROUNDING,
        **how: Any,
    ) -> None:
        """Add a line: errors at the subject's own steps, and the order over all steps.

        Args:
            integrator: a registered name or ``"module:Class"``.
            quantity: what was measured, in words.
            errors: by step in s; not finite where the motion diverged.
            unit: SI unit of the errors.
            scale: size of what is off, in the same unit: it says what rounding is.
            exact: why the exact motion has no error.
            rounding: share of the scale below which an error says nothing of the method.
            how: `exactly` and `at_most` of :func:`order_expected`.
        """
        steps = tuple(sorted(errors, reverse=True))
        own = tuple(step for step in steps if step in self.subject.steps) or steps
        measured = tuple(errors[step] for step in own)
        if integrator == TRUTH:
            exactly = below(EXACT * scale, measured, unit, exact)
            self.add(integrator, quantity, measured, unit, exactly, steps=own)
            return
        order = numerics.slope(steps, tuple(errors[step] for step in steps), rounding * scale)
        expectation = order_expected(numerics.declared(integrator).order, order, **how)
        if expectation.holds and not all(map(math.isfinite, measured)):
            expectation = replace(expectation, holds=False)
        self.add(
            integrator, quantity, measured, unit, expectation,
            steps=own, order=order, order_steps=steps,
        )  # fmt: skip

    def add_ledger(
        self, integrator: str, rollouts: Mapping[float, Rollout], name: str = "", **how: Any
    ) -> None:
        """Add Σ |energy residual|: rounding for the exact motion, else falling at the order.

        Args:
            integrator: a registered name or ``"module:Class"``.
            rollouts: by step in s; of several lanes the mean is taken.
            name: of the motion, where the section has several.
            how: as for :meth:`add_order`.
        """
        errors = {dt: float(r.residual().mean()) for dt, r in rollouts.items()}
        quantity = f"{name}, Σ |energy residual|" if name else "Σ |energy residual|"
        self.add_order(integrator, quantity, errors, "J", _largest_energy(rollouts), **how)

    def add_booked(
        self,
        integrator: str,
        rollouts: Mapping[float, Rollout],
        quantity: str,
        name: str,
        truth: Array,
    ) -> None:
        """Add what the ledger books up to each instant against an independent integral.

        Args:
            integrator: a registered name or ``"module:Class"``.
            rollouts: of one lane, by step in s.
            quantity: what is booked, in words.
            name: under which it is in ``info``.
            truth: the integral up to each control instant, J, shape (instants,).
        """
        errors = {
            dt: float(np.abs(r.so_far(name)[:, 0] - truth).max()) for dt, r in rollouts.items()
        }
        quantity = f"{quantity}, largest error against SciPy's {np.abs(truth).max():.3g} J"
        scale = _largest_energy(rollouts)
        self.add_order(integrator, quantity, errors, "J", scale, rounding=SCIPY)

    def add_solver(
        self,
        integrator: str,
        rollouts: Sequence[Rollout],
        quantity: str = "most solver iterations in a step",
        steps: tuple[float, ...] = (),
        stable: Sequence[bool] = (),
    ) -> None:
        """Add the most iterations of each rollout, and whether every step was solved.

        Nothing is added for an integrator without a solver.

        Args:
            integrator: a registered name or ``"module:Class"``.
            rollouts: the motions.
            quantity: what was counted, in words.
            steps: integration steps of the rollouts, s.
            stable: which of them should be solved; empty: all.
        """
        owner = INTEGRATORS.load(integrator)
        cap, tolerance = (getattr(owner, f"solver_{x}", None) for x in ("cap", "tolerance"))
        if cap is None or tolerance is None:
            return
        most, worst = (
            [float(np.nanmax(r.info[f"solver_{name}"])) for r in rollouts]
            for name in ("iterations", "residual")
        )
        asked = [x for x, y in zip(worst, stable or [True] * len(worst), strict=True) if y]
        if asked:
            words = "solved" if len(asked) == len(worst) else "solved where it does not grow"
            within = f"residual up to {amount(tolerance)} in {cap} iterations"
            expectation = Expectation(words, within, all(x <= tolerance for x in asked))
            self.add(integrator, quantity, most, "", expectation, steps=steps)


def _largest_energy(rollouts: Mapping[float, Rollout]) -> float:
    """Of the finest motion, J."""
    return float(np.nanmax(rollouts[min(rollouts)].info["energy"]))
