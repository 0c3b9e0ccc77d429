"""``panel.json`` made again from the records and the plan of its run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import msgspec

from integ_gym.support import plural

from ..model import Panel
from ..running import RunDirectory, evaluated
from ..specification import PanelSpec, planned_home
from .comparing import Difference, differences
from .given import given_rows
from .outputs import artefact_of, policies_of, reduced, rows_of, stage, trained

_UNDECIDED = "Not decided yet"


def deviations(
    directory: RunDirectory, spec: PanelSpec, plan: Mapping[str, Any], said: Panel
) -> Iterator[Difference]:
    """What ``panel.json`` says and is not what its run's records come to.

    Args:
        directory: of the run, whose records are complete.
        spec: that its plan describes.
        plan: the `specification` of its manifest.
        said: what ``panel.json`` holds.

    Raises:
        SpecError: for a plan that does not say the home of a policy that was given.
        ValueError: for one that tells of fewer seeds than the plan has.
    """
    told = {name: getattr(said, name) for name in Panel.__struct_fields__ if name in _KEPT}
    made = _evaluated if "policy" in plan else _trained
    yield from differences(said, made(directory, spec, plan, said, told))


_KEPT = (
    *("name", "question", "warnings", "spec", "protocol_gaps", "command", "directory", "versions"),
    *("cost", "looks"),
)
"""Attributes that the records do not tell."""


def _trained(
    directory: RunDirectory,
    spec: PanelSpec,
    plan: Mapping[str, Any],
    said: Panel,
    told: dict[str, Any],
) -> Panel:
    """A panel, or what is there of it: the rows with as many seeds as it tells of."""
    seeds = max((len(row.policies) for row in said.rows if row.kind == "trained"), default=0)
    part = replace(spec, seeds=spec.seeds[:seeds])
    undecided = stage(part, spec)["undecided"] if said.answer.startswith(_UNDECIDED) else ""
    if seeds < len(spec.seeds) and not undecided:
        raise ValueError(f"it tells of {seeds} of {plural(len(spec.seeds), 'seed')}")
    layout, matrix = reduced(part, directory, rows_of(part))
    own = trained(part, directory, layout, matrix)
    policies = policies_of(part, directory)
    return artefact_of(directory, layout, matrix, policies, **told, **own, undecided=undecided)


def _evaluated(
    directory: RunDirectory,
    spec: PanelSpec,
    plan: Mapping[str, Any],
    said: Panel,
    told: dict[str, Any],
) -> Panel:
    """An evaluation, whose records and plan know no seed or file of the policy's."""
    row, held = spec.name.removeprefix("evaluate "), evaluated(directory)
    layout, matrix = reduced(spec, directory, given_rows(spec, row, planned_home(plan)))
    policies = [policy for one in said.rows for policy in one.policies]
    hashed = [msgspec.structs.replace(x, hash=x.hash and held[x.id].policy_hash) for x in policies]
    return artefact_of(directory, layout, matrix, hashed, **told)
