"""A whole diagnosis: all sections, ``diagnose.json``, figures and evidence."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from integ_gym.envs.registries import INTEGRATORS
from integ_gym.evidence.record import plain
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError, IntegGymError, is_raised_under
from integ_gym.support.files import cannot_write, make_folder, replace_file
from integ_gym.support.processes import Progress
from integ_gym.support.terminal import WorkBar

from ..panel.run_directory import package_versions
from .bench import Bench
from .contact import diagnose_contact
from .control import diagnose_actuation, diagnose_latency, diagnose_refinement
from .figures import write_diagnosis_figures
from .identity import diagnose_identity, diagnose_plant
from .lines import Diagnosis
from .oscillations import diagnose_free_motion, diagnose_stiffness
from .page import write_page
from .resistances import diagnose_damping, diagnose_friction
from .subject import Subject, check_integrator, subjects

SCHEMA_VERSION = 1
"""Version of ``diagnose.json``."""

RESULT = "diagnose.json"

SECTIONS: dict[str, Callable[[Diagnosis], None]] = {
    "plant": diagnose_plant,
    "integrator": diagnose_identity,
    "free motion": diagnose_free_motion,
    "stiffness": diagnose_stiffness,
    "damping": diagnose_damping,
    "friction": diagnose_friction,
    "contact": diagnose_contact,
    "actuation": diagnose_actuation,
    "timestep refinement": diagnose_refinement,
    "latency": diagnose_latency,
}
"""Sections in the order in which they are shown."""

_NEED_REST = ("free motion", "stiffness", "damping", "friction")
"""Sections about small oscillations: a plant that does not come to rest has none."""

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


Job = tuple[str, Subject, tuple[str, ...], Path, bool]
"""What a worker does at a time: the arguments of :func:`examine`."""


def examine(
    section: str, subject: Subject, integrators: tuple[str, ...], evidence: Path, leads: bool
) -> Diagnosis:
    """Run one section on one plant, and commit its evidence.

    Raises:
        DiagnosisError: naming the plant and the integrator that failed.
    """
    bench = Bench(EvidenceStore(evidence), run_id="diagnose")
    diagnosis = Diagnosis(section, bench, subject, integrators, leads)
    try:
        SECTIONS[section](diagnosis)
    except Exception as error:
        # Whose step it was, where one of them was at work.
        failed = [n for n in integrators if is_raised_under(INTEGRATORS.load(n), error)]
        names = failed or integrators
        own = any(":" in name for name in (subject.name, *names))
        remedy = (
            "docs/how-to/adding.md says what a plant and an integrator must be"
            if own
            else "this is a fault of integ-gym's: please report it with this line"
        )
        raise DiagnosisError(
            f"{section} of {subject.name} with {', '.join(names)} failed: "
            f"{type(error).__name__}: {' '.join(str(error).split())}; {remedy}"
        ) from error
    bench.commit(section.replace(" ", "_"))
    return diagnosis


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
    jobs: list[Job] = [
        (section, subject, names, unfinished, subject is plants[0])
        for subject in plants
        for section in SECTIONS
        if subject.rests or section not in _NEED_REST
    ]
    with WorkBar("diagnose", len(jobs), progress, unit=" sections") as bar:
        try:
            found = {}
            for place, part in _examine_all(jobs, workers):
                found[place] = part
                bar.update()
            for earlier in ("evidence", "figures"):
                shutil.rmtree(directory / earlier, ignore_errors=True)
            unfinished.rename(directory / "evidence")
        except OSError as error:
            raise cannot_write(directory, error) from error
        except DiagnosisError as error:
            raise DiagnosisError(str(error)) from error
        finally:
            shutil.rmtree(unfinished, ignore_errors=True)
        bar.describe("writing figures and page")
        parts = [found[place] for place in range(len(jobs))]
        records = EvidenceStore(directory / "evidence").count()
        result = {**_result(parts, plants, names, command), "records": records}
        text = json.dumps(result, indent=1, allow_nan=False)
        replace_file(directory / RESULT, text.encode())
        write_diagnosis_figures(result, directory / "figures")
        write_page(result, directory)
        bar.describe("")
    return result


def _examine_all(jobs: Sequence[Job], workers: int) -> Iterator[tuple[int, Diagnosis]]:
    """Places of jobs, with their results, as they are done."""
    if min(workers, len(jobs)) < 2:
        yield from ((place, examine(*job)) for place, job in enumerate(jobs))
        return
    with Progress().pool(workers) as pool:
        order = sorted(range(len(jobs)), key=lambda place: jobs[place][0] not in _LONGEST)
        running = {pool.submit(examine, *jobs[place]): place for place in order}
        for future in as_completed(running):
            yield running[future], future.result()


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
        "identities": [one for part in parts for one in part.identities],
        "findings": [finding.row() for part in parts for finding in part.findings],
        "curves": plain(curves, _DIGITS),
    }
    return {name: plain(value) for name, value in result.items()}
