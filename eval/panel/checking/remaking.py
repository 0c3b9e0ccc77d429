"""``panel.json`` made again from the plan, the markers and the records of its run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from integ_gym.evidence.schema import Finding
from integ_gym.support.errors import InputError
from integ_gym.support.terminal import plural

from ..artefact import differences
from ..existing.facts import given_panel, other_facts
from ..outputs import noted_call, panel_of, seen_now
from ..result import FILE_NAME, Panel
from ..running.run_directory import MANIFEST, RunDirectory
from ..spec import PanelSpec


def deviations(
    directory: RunDirectory, spec: PanelSpec, said: Panel, own_code: bool
) -> Iterator[Finding]:
    """What ``panel.json`` says and is not what its run's plan and records come to.

    Args:
        directory: of the run, whose records are complete.
        spec: that its plan describes.
        said: what ``panel.json`` holds.
        own_code: whether code that a side-car names may be loaded.

    Raises:
        SpecError: for a plan that does not say the home of a policy that was given.
        ValueError: for a run that does not say how it was called, or for a panel of fewer seeds
            than were judged.
    """
    called = noted_call(directory)
    if "policy" in directory.manifest()["specification"]:
        for name, *told in other_facts(spec, directory, own_code):
            yield _deviation(MANIFEST, f"given.{name}", *told)
        made = given_panel(spec, directory, called)
    else:
        part = _part(directory, spec, said)
        made = panel_of(part, directory, called, None if part is spec else spec)
    for place, *told in differences(said, made):
        yield _deviation(FILE_NAME, place, *told)


def _part(directory: RunDirectory, spec: PanelSpec, said: Panel) -> PanelSpec:
    """The panel, or before its verdicts were seen as many of its seeds as are told of.

    Raises:
        ValueError: for one that tells of fewer seeds than were judged.
    """
    if seen_now(spec) in directory.looks():
        return spec
    seeds = max((len(row.policies) for row in said.rows if row.kind == "trained"), default=0)
    if not 0 < seeds < len(spec.seeds):
        raise InputError(f"it tells of {seeds} of {plural(len(spec.seeds), 'seed')}")
    return replace(spec, seeds=spec.seeds[:seeds])


def _deviation(file: str, place: str, said: Any, made: Any) -> Finding:
    return Finding(
        file, None, f"`{place}` is recorded as {said!r:.80}, and comes out as {made!r:.80}"
    )
