"""What the sections of a diagnosis share: who is examined, and how lines and curves are kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from integ_gym.envs.registries import TRUTH

from .bench.bench import Bench, Commands
from .bench.rollout import Array, Rollout
from .bench.subject import Subject
from .lines.expectation import Expectation
from .lines.finding import Finding

NO_CONTROL = np.zeros(1)


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
        told: what each integrator is on this plant.
    """

    section: str
    bench: Bench
    subject: Subject
    integrators: tuple[str, ...]
    leads: bool = True
    findings: list[Finding] = field(default_factory=list)
    curves: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    told: list[dict[str, Any]] = field(default_factory=list)

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
            values: commands, one per decision, in the plant's unit.
            name: tells motions of the section apart.
            arguments: constructor arguments; ``duration`` in s among them.
        """
        named = f"{name}/" if name else ""
        return {
            dt: self.bench.open_loop(
                f"{self.section}/{named}{integrator}/dt={dt:g}", self.subject, integrator, dt,
                Commands(name or "zero", values), start[None], **arguments,
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
