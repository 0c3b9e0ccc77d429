"""A whole diagnosis: all sections, ``diagnose.json``, figures and evidence."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.eval.diagnose_figures import write_diagnosis_figures
from integ_gym.eval.diagnosis import (
    actuation,
    damping,
    free_motion,
    identity,
    latency,
    refinement,
    stiffness,
)
from integ_gym.eval.diagnosis.bench import Bench
from integ_gym.eval.diagnosis.section import Diagnosis
from integ_gym.eval.diagnosis.subject import Subject, subjects
from integ_gym.eval.report_data import write_atomically
from integ_gym.evidence.provenance import package_versions
from integ_gym.evidence.store import EvidenceStore

SCHEMA_VERSION = 1
"""Version of ``diagnose.json``."""

RESULT = "diagnose.json"

SECTIONS: dict[str, Callable[[Diagnosis], None]] = {
    identity.SECTION: identity.diagnose_identity,
    free_motion.SECTION: free_motion.diagnose_free_motion,
    stiffness.SECTION: stiffness.diagnose_stiffness,
    damping.SECTION: damping.diagnose_damping,
    actuation.SECTION: actuation.diagnose_actuation,
    refinement.SECTION: refinement.diagnose_refinement,
    latency.SECTION: latency.diagnose_latency,
}
"""Sections in the order in which they are run and shown."""


@dataclass(frozen=True)
class Request:
    """What to diagnose.

    Attributes:
        env_id: an environment, whose plant is taken; or None.
        plant: a registered name or ``"module:Class"``; None: all plants.
        integrators: names or references; empty: all.
        steps: integration steps, s; one is halved twice; empty: the environments' own.
    """

    env_id: str | None = None
    plant: str | None = None
    integrators: Sequence[str] = ()
    steps: Sequence[float] = ()

    def chosen(self) -> tuple[list[Subject], tuple[str, ...]]:
        """Plants and integrators.

        Raises:
            ValueError: for an unknown environment, plant or integrator, or an impossible step.
        """
        names = tuple(dict.fromkeys(self.integrators)) or INTEGRATORS.names()
        for name in names:
            INTEGRATORS.load(name)
        return subjects(self.env_id, self.plant, self.steps), names


def work(request: Request) -> int:
    """Units of work of a diagnosis."""
    plants, names = request.chosen()
    return len(SECTIONS) * len(plants) * len(names)


def diagnose(
    request: Request, directory: Path, command: str, on_unit: Callable[[], object]
) -> dict[str, Any]:
    """Run every section and write its results.

    Args:
        request: what to diagnose.
        directory: where ``diagnose.json``, ``figures`` and ``evidence`` go.
        command: what was typed, for the record.
        on_unit: called after every unit of work; see :func:`work`.

    Returns:
        The content of ``diagnose.json``.

    Raises:
        ValueError: for what cannot be diagnosed, or a directory that holds a diagnosis already.
    """
    if (directory / "evidence").exists() or (directory / RESULT).exists():
        raise ValueError(
            f"{directory} already holds a diagnosis; give another --out, or remove the directory"
        )
    plants, names = request.chosen()
    bench = Bench(EvidenceStore(directory / "evidence"), run_id="diagnose")
    diagnosis = Diagnosis(bench, plants, names, lambda: (on_unit(), None)[1])
    for section, examine in SECTIONS.items():
        examine(diagnosis)
        bench.commit(section.replace(" ", "_"))
    result = _result(diagnosis, command)
    text = json.dumps(result, indent=1, allow_nan=False)
    write_atomically(directory / RESULT, text.encode())
    write_diagnosis_figures(result, directory / "figures")
    return result


def _result(diagnosis: Diagnosis, command: str) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "command": command,
        "versions": package_versions({}),
        "plants": [
            {
                "name": s.name,
                "environments": list(s.environments),
                "dt_s": list(s.steps),
                "control_period_s": s.control_period,
                "rest_state": s.rest.tolist(),
                "frequency_rad_s": s.frequency,
            }
            for s in diagnosis.subjects
        ],
        "integrators": [
            {"name": name, "is": identity.sentence(name)} for name in diagnosis.integrators
        ],
        "findings": [finding.row() for finding in diagnosis.findings],
        "curves": _finite(diagnosis.curves),
        "records": diagnosis.bench.store.count(),
    }


def _finite(value: Any) -> Any:
    """Nested lists and dicts with null for what is not finite."""
    if isinstance(value, dict):
        return {name: _finite(x) for name, x in value.items()}
    if isinstance(value, list):
        return [_finite(x) for x in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
