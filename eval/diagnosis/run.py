"""A whole diagnosis: all sections, ``diagnose.json``, figures and evidence."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from integ_gym.envs.registries import INTEGRATORS
from integ_gym.evidence.record import plain
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError, IntegGymError, is_raised_under
from integ_gym.support.files import cannot_write, make_folder, replace_file
from integ_gym.support.processes import Progress, work_bar

from ..panel.run_directory import package_versions
from .bench import Bench
from .figures import write_diagnosis_figures
from .lines import Diagnosis
from .page import write_page
from .sections import (
    actuation,
    contact,
    damping,
    free_motion,
    friction,
    identity,
    latency,
    plant,
    refinement,
    stiffness,
)
from .subject import Subject, check_integrator, subjects

SCHEMA_VERSION = 1
"""Version of ``diagnose.json``."""

RESULT = "diagnose.json"

SECTIONS: dict[str, Callable[[Diagnosis], None]] = {
    "plant": plant.diagnose_plant,
    "integrator": identity.diagnose_identity,
    "free motion": free_motion.diagnose_free_motion,
    "stiffness": stiffness.diagnose_stiffness,
    "damping": damping.diagnose_damping,
    "friction": friction.diagnose_friction,
    "contact": contact.diagnose_contact,
    "actuation": actuation.diagnose_actuation,
    "timestep refinement": refinement.diagnose_refinement,
    "latency": latency.diagnose_latency,
}
"""Sections in the order in which they are shown."""

_LONGEST = ("timestep refinement", "latency")
"""Sections that are begun first, so that no worker is left alone with one at the end."""

_DIGITS = 9
"""Significant digits of what figures draw."""


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
            ValueError: for an unknown environment, plant or integrator, an impossible step, or an
                integrator that cannot take one.
        """
        names = tuple(dict.fromkeys(self.integrators)) or INTEGRATORS.names()
        plants = subjects(self.env_id, self.plant, self.steps)
        for name in names:
            for subject in plants:
                check_integrator(name, subject)
        return plants, names


class DiagnosisError(IntegGymError, ValueError):
    """A plant or integrator that cannot be diagnosed, in one sentence."""


@dataclass(frozen=True)
class _Job:
    """One section on one plant: what a worker does at a time."""

    section: str
    subject: Subject
    integrators: tuple[str, ...]
    evidence: Path
    leads: bool

    def run(self) -> Diagnosis:
        """Examine, and commit the evidence.

        Raises:
            DiagnosisError: naming the plant and the integrator that failed.
        """
        bench = Bench(EvidenceStore(self.evidence), run_id="diagnose")
        diagnosis = Diagnosis(self.section, bench, self.subject, self.integrators, self.leads)
        try:
            SECTIONS[self.section](diagnosis)
        except Exception as error:
            raise DiagnosisError(self._failure(error)) from error
        bench.commit(self.section.replace(" ", "_"))
        return diagnosis

    def _failure(self, error: Exception) -> str:
        """A sentence on what failed, with whose step it was where one of them was at work."""
        failed = (n for n in self.integrators if is_raised_under(INTEGRATORS.load(n), error))
        names = tuple(failed) or self.integrators
        what = " ".join(str(error).split())
        own = any(":" in name for name in (self.subject.name, *names))
        remedy = (
            "docs/how-to/adding.md says what a plant and an integrator must be"
            if own
            else "this is a fault of integ-gym's: please report it with this line"
        )
        return (
            f"{self.section} of {self.subject.name} with {', '.join(names)} failed: "
            f"{type(error).__name__}: {what}; {remedy}"
        )


def diagnose(
    request: Request, directory: Path, command: str, workers: int = 1, progress: bool = False
) -> dict[str, Any]:
    """Run every section and write its results.

    Args:
        request: what to diagnose.
        directory: where ``diagnose.json``, its page, ``figures`` and ``evidence`` go, in place of
            those of an earlier diagnosis; of one that fails nothing is kept.
        command: what was typed, for the record.
        workers: processes.
        progress: whether to show a progress bar.

    Returns:
        The content of ``diagnose.json``.

    Raises:
        ValueError: for what cannot be diagnosed, or a directory that holds other evidence or
            cannot be written to.
    """
    if directory.is_file():
        raise InputError(f"{directory} is a file; --out needs a directory")
    if (directory / "evidence").exists() and not (directory / RESULT).exists():
        raise InputError(
            f"{directory} holds evidence of something else than a diagnosis; give another --out"
        )
    plants, names = request.chosen()
    unfinished = make_folder(directory) / "evidence.unfinished"
    shutil.rmtree(unfinished, ignore_errors=True)
    jobs = [
        _Job(section, subject, names, unfinished, subject is plants[0])
        for subject in plants
        for section in SECTIONS
    ]
    with work_bar("diagnose", len(jobs), progress, unit=" sections") as bar:
        try:
            parts = _all(jobs, workers, bar.update)
            for earlier in ("evidence", "figures"):
                shutil.rmtree(directory / earlier, ignore_errors=True)
            unfinished.rename(directory / "evidence")
        except OSError as error:
            raise cannot_write(directory, error) from error
        except DiagnosisError as error:
            raise DiagnosisError(str(error)) from error
        finally:
            shutil.rmtree(unfinished, ignore_errors=True)
        bar.set_postfix_str("writing figures and page")
        result = _result(parts, plants, names, command)
        result["records"] = EvidenceStore(directory / "evidence").count()
        text = json.dumps(result, indent=1, allow_nan=False)
        replace_file(directory / RESULT, text.encode())
        write_diagnosis_figures(result, directory / "figures")
        write_page(result, directory)
        bar.set_postfix_str("", refresh=False)
    return result


def _all(jobs: list[_Job], workers: int, on_job: Callable[[], object]) -> list[Diagnosis]:
    """Results in the order of the jobs."""
    if min(workers, len(jobs)) < 2:
        done = []
        for job in jobs:
            done.append(job.run())
            on_job()
        return done
    with Progress().pool(workers) as pool:
        order = sorted(range(len(jobs)), key=lambda i: jobs[i].section not in _LONGEST)
        running = {pool.submit(jobs[i].run): i for i in order}
        found = {}
        for future in as_completed(running):
            found[running[future]] = future.result()
            on_job()
    return [found[i] for i in range(len(jobs))]


def _result(
    parts: list[Diagnosis], plants: list[Subject], names: tuple[str, ...], command: str
) -> dict[str, Any]:
    curves: dict[str, list[dict[str, Any]]] = {}
    for part in parts:
        for figure, found in part.curves.items():
            curves.setdefault(figure, []).extend(found)
    result: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "command": command,
        "versions": package_versions(),
        "plants": [
            {
                "name": s.name,
                "environments": s.environments,
                "dt_s": s.steps,
                "control_period_s": s.control_period,
                "rest_state": s.rest,
                "frequency_rad_s": s.frequency,
                "slowest_rad_s": s.slowest,
            }
            for s in plants
        ],
        "integrators": names,
        "identities": [told for part in parts for told in part.told],
        "findings": [finding.row() for part in parts for finding in part.findings],
        "curves": plain(curves, _DIGITS),
    }
    return {name: plain(value) for name, value in result.items()}
