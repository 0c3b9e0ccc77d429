"""What is left to be done of a panel, as shared units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from integ_gym.train.fleet.worker import Workers

from ..running.division import divide, waiting_chunks
from ..running.evaluation.achievability import not_tried, unit_of_cell
from ..running.evaluation.subjects import Subject
from ..running.evaluation.units import (
    batches_of,
    knowing_home,
    not_evaluated,
    unit_of,
)
from ..running.panel import subject_of
from ..running.run_directory import RunDirectory
from ..running.units import Unit, units_of
from ..specification.panel_spec import PanelSpec
from .shared_unit import SharedUnit


def training(
    spec: PanelSpec, directory: RunDirectory, workers: Workers, memory_gib: float | None
) -> list[SharedUnit]:
    """Chunks of policies that are trained together."""
    return _together(waiting_chunks(spec, directory, workers, memory_gib))


def training_and_division(
    spec: PanelSpec, directory: RunDirectory, workers: Workers, memory_gib: float | None
) -> tuple[list[SharedUnit], dict[str, Any] | None]:
    """Chunks of policies that are trained together, and what is to be noted of that."""
    division = divide(spec, directory, workers, memory_gib)
    return _together(division.waiting), division.noted


def _together(chunks: Sequence[Sequence[Unit]]) -> list[SharedUnit]:
    names = [tuple(unit.policy for unit in chunk) for chunk in chunks]
    return [SharedUnit("train", _named("train", own), policies=own) for own in names]


def trying(spec: PanelSpec, directory: RunDirectory) -> list[SharedUnit]:
    """Cells in which it is not known what can be done."""
    return [
        SharedUnit("try", unit_of_cell(part, cell), cell=cell.name, first=part.latest.start)
        for part, cell in not_tried(spec, directory)
    ]


def evaluating(spec: PanelSpec, directory: RunDirectory, workers: int) -> list[SharedUnit]:
    """Batches of policies that are evaluated side by side from the starts that came last.

    All are trained, and evaluated from the starts before.
    """
    subjects = [subject_of(spec, directory, unit) for unit in units_of(spec)]
    return [unit for unit, _ in batches(spec, directory, subjects, workers)]


def batches(
    spec: PanelSpec, directory: RunDirectory, subjects: Sequence[Subject], workers: int
) -> list[tuple[SharedUnit, tuple[Subject, ...]]]:
    """Batches of given policies, from the starts that came last."""
    waiting = knowing_home(spec, directory, not_evaluated(spec, directory, subjects))
    return [
        (
            SharedUnit(
                "evaluate",
                unit_of(spec, batch)[0],
                policies=tuple(subject.policy.policy_id for subject in batch),
                recorded=tuple(sorted(batch[0].recorded)),
                first=spec.latest.start,
                at_home=tuple(
                    (subject.policy.policy_id, home, *counts)
                    for subject in batch
                    for home, counts in subject.at_home.items()
                ),
            ),
            batch,
        )
        for batch in batches_of(spec, waiting, workers)
    ]


def _named(kind: str, policies: Sequence[str]) -> str:
    others = len(policies) - 1
    return f"{kind}-{policies[0]}" + (f"-and-{others}-more" if others else "")
