"""One section of a diagnosis on one plant, for tests."""

from __future__ import annotations

from pathlib import Path

from integ_gym.eval.diagnosis.bench import Bench
from integ_gym.eval.diagnosis.lines import Diagnosis, Finding
from integ_gym.eval.diagnosis.run import SECTIONS
from integ_gym.eval.diagnosis.subject import subjects
from integ_gym.evidence.store import EvidenceStore

RESTING = tuple(subject.name for subject in subjects(None, None, []) if subject.rests)
"""Plants that come to rest without control."""

MOVING = tuple(subject.name for subject in subjects(None, None, []) if not subject.rests)
"""The others."""


def examine(section: str, plant: str, *integrators: str, steps=(), store: Path) -> list[Finding]:
    """Findings of a section; its records are committed to a store."""
    (subject,) = subjects(None, plant, list(steps))
    bench = Bench(EvidenceStore(store), "test")
    diagnosis = Diagnosis(section, bench, subject, integrators)
    SECTIONS[section](diagnosis)
    bench.commit("test")
    return diagnosis.findings


def lines(findings: list[Finding], fragment: str, integrator: str = "") -> list[Finding]:
    """Findings on a quantity, of one integrator or of all."""
    found = [
        f
        for f in findings
        if fragment in f.quantity and (not integrator or f.integrator == integrator)
    ]
    assert found, fragment
    return found


def verdicts(findings: list[Finding], fragment: str, integrator: str = "") -> set[bool | None]:
    """What they say of their expectations."""
    return {f.holds for f in lines(findings, fragment, integrator)}
