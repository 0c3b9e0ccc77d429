"""What the sections of a diagnosis share: who is examined, and how lines and curves are kept."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from integ_gym.eval.diagnosis.bench import Bench
from integ_gym.eval.diagnosis.finding import Finding
from integ_gym.eval.diagnosis.subject import Subject

TRUTH = "reference"
"""The integrator that the others are compared with."""


def steps_for(subject: Subject, integrator: str) -> tuple[float, ...]:
    """Steps to take, coarse to fine: the exact motion is the same at every step."""
    return subject.steps[:1] if integrator == TRUTH else subject.steps


@dataclass
class Diagnosis:
    """A diagnosis under way.

    Attributes:
        bench: where rollouts are run.
        subjects: the plants.
        integrators: names or references.
        leads: whether it also says what does not depend on the plant.
        findings: the lines so far.
        curves: what the figures draw, by name of the figure.
        metrics: success of the hand-made controller, by what it met.
    """

    bench: Bench
    subjects: list[Subject]
    integrators: tuple[str, ...]
    leads: bool = True
    findings: list[Finding] = field(default_factory=list)
    curves: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    metrics: dict[tuple[Any, ...], float | None] = field(default_factory=dict)

    def pairs(self) -> Iterator[tuple[Subject, str]]:
        """Every plant with every integrator."""
        for subject in self.subjects:
            for integrator in self.integrators:
                yield subject, integrator

    def add(self, section: str, subject: Subject, integrator: str, *line: Any, **more: Any) -> None:
        """Add a line; see :class:`Finding` for what follows."""
        self.findings.append(Finding(section, subject.name, integrator, *line, **more))

    def draw(self, figure: str, **curve: Any) -> None:
        """Keep a curve for a figure."""
        self.curves.setdefault(figure, []).append(curve)
