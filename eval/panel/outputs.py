"""What a finished run writes: verdicts, figures, the page and `panel.json`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import accumulate
from typing import Any, Final, Literal

import msgspec

from integ_gym.evidence.sealing import seal
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError
from integ_gym.support.files import display_path
from integ_gym.support.processes import limit_threads
from integ_gym.support.terminal import plural
from integ_gym.train.policy_files.sidecar import policy_file

from ..report.figures import write_figures
from ..report.page import write_report
from ..verdict import ALPHA, share_of_look
from .achieve import tried
from .artefact import as_sealed, build_artefact
from .checking.plan import check_records
from .evaluate import evaluated
from .findings import agreements, training_costs
from .matrix import COLUMNS, Matrix, PanelLayout, Row, applied_in, reward_doubts
from .result import Cost, Panel, Policy, write_panel
from .run_directory import (
    CALLED,
    MANIFEST,
    RunDirectory,
    Seen,
)
from .spec import PanelSpec
from .units import panel_bar, training_config, units_of

Phase = Literal["checking records", "judging", "drawing figures", "writing the page"]

CHECKING: Final = "checking records"
JUDGING: Final = "judging"
DRAWING: Final = "drawing figures"
WRITING: Final = "writing the page"

_SECONDS: dict[Phase, float] = {CHECKING: 3.0, JUDGING: 9.0, DRAWING: 5.0, WRITING: 3.0}
"""What is done, in words and in order, and time that it takes of the quick panel, s."""

_BEFORE = dict(zip(_SECONDS, accumulate(_SECONDS.values(), initial=0.0), strict=False))

Begin = Callable[[Phase], None]
"""Told what is done now."""


def untold(phase: Phase) -> None:
    """Nobody is told."""


@contextmanager
def phases(label: str, shown: bool) -> Iterator[Begin]:
    """What is to be told what is done now, for a bar over all of it.

    Args:
        label: of the run.
        shown: whether the bar is.
    """
    with panel_bar(f"{label}, page", sum(_SECONDS.values()), shown) as bar:

        def begin(phase: Phase) -> None:
            bar.update(_BEFORE[phase] - bar.n)
            bar.describe(phase)

        yield begin
        bar.describe("")


def write_artefact(
    spec: PanelSpec,
    directory: RunDirectory,
    command: str,
    workers: int,
    of: PanelSpec | None = None,
    begin: Begin = untold,
) -> Panel:
    """Reduce the evidence and write ``panel.json``, ``figures/`` and ``report.html``.

    Args:
        spec: the panel, or a stage of it.
        directory: in which all of that is finished.
        command: how to run it again, for the page.
        workers: processes that it ran in.
        of: the panel whose stage it is; nothing is decided then.
        begin: told what is done now.
    """
    begin(CHECKING)
    check_records(directory)
    begin(JUDGING)
    if of is None:
        directory.record_look(seen_now(spec))
    called = call_of(directory, command, workers)
    made = panel_of(spec, directory, called, of)
    return write_outputs(directory, made, called, begin, decided=of is None)


def panel_of(
    spec: PanelSpec,
    directory: RunDirectory,
    called: Mapping[str, Any],
    of: PanelSpec | None = None,
) -> Panel:
    """What ``panel.json`` holds of a panel: a function of its plan, markers and records alone.

    Args:
        spec: the panel, or a stage of it.
        directory: in which all of that is finished.
        called: see :func:`call_of`.
        of: the panel whose stage it is; nothing is decided then.
    """
    layout, matrix = reduced(spec, directory, rows_of(spec))
    looked = _looks(layout) if of is None else stage(spec, of)
    doubts = reward_doubts(spec.env_id, EvidenceStore(directory.evidence))
    return artefact_of(
        directory,
        layout,
        matrix,
        policies_of(spec, directory),
        **of_plan(of or spec, directory, called),
        cost=cost_of(directory, layout, [unit.training for unit in units_of(spec)], called),
        **trained(spec, directory, layout, matrix),
        **{**looked, "warnings": (*doubts, *looked["warnings"])},
    )


def rows_of(spec: PanelSpec) -> tuple[Row, ...]:
    """What was trained, then the baselines."""
    units, homes = units_of(spec), {home.name: home for home in spec.train}
    return tuple(
        Row(
            name=name,
            kind="trained" if name in homes else "baseline",
            policies=tuple(unit.policy for unit in units if unit.row == name),
            trained_on=homes.get(name),
        )
        for name in dict.fromkeys((*homes, *spec.baselines))
    )


def policies_of(spec: PanelSpec, directory: RunDirectory) -> list[Policy]:
    """Policies of a panel, with the hashes that they were evaluated under."""
    held = evaluated(directory)
    return [
        Policy(
            id=unit.policy,
            seed=unit.seed,
            hash=held[unit.policy].policy_hash,
            file=_file(directory, unit.policy) if unit.home else None,
        )
        for unit in units_of(spec)
    ]


def _file(directory: RunDirectory, policy: str) -> str:
    """Path of a policy's file in a run."""
    return policy_file(directory.policies / policy).relative_to(directory.path).as_posix()


def trained(
    spec: PanelSpec, directory: RunDirectory, layout: PanelLayout, matrix: Matrix
) -> dict[str, Any]:
    """What a panel finds beside the outcomes of its rows in their cells."""
    rows = {row.name: row.policies for row in layout.rows if row.kind == "trained"}
    return {
        "training_steps": training_config(spec, units_of(spec)[-1]).total_steps,
        "training_costs": training_costs(EvidenceStore(directory.evidence), rows),
        "engine_agreement": agreements(layout, matrix, spec),
    }


def seen_now(spec: PanelSpec) -> Seen:
    """What verdicts rest on."""
    trained = {home.name for home in spec.train}
    natives = sum(cell in trained and cell != row for row, cell in spec.family)
    return Seen(len(spec.seeds), spec.episodes, natives)


def _looks(layout: PanelLayout) -> dict[str, Any]:
    return {"looks": layout.looks, "warnings": tuple(look_warnings(layout))}


def look_warnings(layout: PanelLayout) -> Iterator[str]:
    """That what is concluded was seen before, with fewer seeds or starts."""
    planned = layout.looks_before.planned
    if planned and layout.looks and layout.looks[-1].seeds not in planned:
        yield (
            f"This look at {plural(layout.looks[-1].seeds, 'seed')} was not planned: the "
            f"specification's `looks` are at {', '.join(map(str, planned))} seeds, which have the "
            "whole level. So it gives no verdict."
        )
    if len(layout.looks) < 2:
        return
    before, now = layout.looks[-2:]
    number = len(layout.looks)
    if any(row.kind == "given" for row in layout.rows):
        yield (
            f"These results were seen before, the last time on {plural(before.episodes, 'start')}: "
            f"this is look {number}. Looks share the level of {ALPHA}, so p-values are multiplied "
            f"by {1.0 / share_of_look(number):.0f} here. What is called practically equal goes by "
            "95 % intervals, which are not adjusted for looks: it is no verdict."
        )
    if not (layout.family or layout.compare):
        return
    seen = f"{plural(before.seeds, 'seed')} of {plural(before.episodes, 'start')}"
    if before.adopted:
        seen += " in the run whose policies were taken"
    levels = {"fails": now.level_exceeds, "transfers": now.level_equivalent}
    told = (
        f"{level:.2g} to `{verdict}`" if level else f"nothing to `{verdict}`"
        for verdict, level in levels.items()
    )
    yield (
        f"Verdicts were seen before, the last on {seen}; this is look {number}. Looks share the "
        f"level of {ALPHA}: this one gives {' and '.join(told)}, and its p-values are multiplied "
        "accordingly."
    )


def stage(spec: PanelSpec, of: PanelSpec) -> dict[str, Any]:
    """What a panel says of itself of which some seeds are there."""
    sentence = (
        f"Not decided yet: {len(spec.seeds)} of {len(of.seeds)} training seeds are here; the rest "
        "is being trained and judged, and this page is written again as they arrive."
    )
    return {"undecided": sentence, "warnings": (sentence,)}


def reduced(
    spec: PanelSpec, directory: RunDirectory, rows: tuple[Row, ...]
) -> tuple[PanelLayout, Matrix]:
    """The rows' cells, and what the evaluation episodes on record came to."""
    store = EvidenceStore(directory.evidence)
    table = store.query(f"SELECT {', '.join(COLUMNS)} FROM records WHERE phase = 'evaluation'")
    layout = PanelLayout.of(spec, rows, tried(directory), applied_in(store), directory.looks())
    return layout, Matrix(rows, table.to_pylist(), spec.episodes, spec.trace_every)


def call_of(directory: RunDirectory, command: str, workers: int) -> dict[str, Any]:
    """How a run was called, as its manifest keeps it."""
    place = display_path(str(directory.storage))
    return {"command": command, "workers": workers, "directory": place}


def noted_call(directory: RunDirectory) -> dict[str, Any]:
    """How a run was called when its page was written.

    Raises:
        ValueError: where its manifest does not say so, as those of before it was kept.
    """
    try:
        told = msgspec.convert(directory.manifest().get(CALLED), _Call)
    except msgspec.ValidationError as error:
        raise InputError(f"its {MANIFEST} does not say how it was called ({error})") from None
    return dict(msgspec.to_builtins(told))


class _Call(msgspec.Struct):
    """What a manifest keeps of a call."""

    command: str
    workers: int
    directory: str


def of_plan(spec: PanelSpec, directory: RunDirectory, called: Mapping[str, Any]) -> dict[str, Any]:
    """What a panel takes from its plan, and from how it was called."""
    manifest = directory.manifest()
    return {
        "name": spec.name,
        "question": manifest["specification"]["question"],
        "spec": manifest["specification"],
        "protocol_gaps": tuple(spec.gaps()),
        "versions": manifest["versions"],
        "command": called["command"],
        "directory": called["directory"],
    }


def write_outputs(
    directory: RunDirectory,
    made: Panel,
    called: Mapping[str, Any],
    begin: Begin = untold,
    decided: bool = True,
) -> Panel:
    """Write ``panel.json`` and the figures, seal the run if it is decided, and write the page.

    Of a sealed run that nothing was added to, ``panel.json`` stays as it is, and so does the seal.

    Args:
        directory: of the finished run.
        made: what was found.
        called: see :func:`call_of`.
        begin: told what is done now.
        decided: whether all of the panel is there.
    """
    panel = as_sealed(directory, made)
    if panel is made:
        directory.note(**{CALLED: dict(called)})
        write_panel(panel, directory.path)
    begin(DRAWING)
    write_figures(panel, directory.path / "figures")
    begin(WRITING)
    if decided:
        seal(directory.path)
    write_report(panel, directory.path)
    return panel


def artefact_of(
    directory: RunDirectory,
    layout: PanelLayout,
    matrix: Matrix,
    policies: Sequence[Policy],
    /,
    **told: Any,
) -> Panel:
    """What ``panel.json`` holds; see :func:`build_artefact`.

    Its products are of small matrices: more threads than one take longer, and round otherwise.
    """
    with limit_threads():
        return build_artefact(
            layout,
            matrix,
            {policy.id: policy for policy in policies},
            {policy: there.files for policy, there in evaluated(directory).items()},
            **told,
        )


def cost_of(
    directory: RunDirectory,
    layout: PanelLayout,
    training: Sequence[str],
    called: Mapping[str, Any],
) -> Cost:
    """What a run took, interrupted runs included.

    Args:
        directory: of the run.
        layout: whose policies were evaluated.
        training: names of its training units.
        called: see :func:`call_of`.
    """
    found = evaluated(directory)
    policies = [policy for row in layout.rows for policy in row.policies]
    evaluation = sorted({unit for policy in policies for unit in found[policy].units})
    return Cost(
        wall_seconds=round(directory.wall_seconds([*training, *evaluation]), 1),
        workers=called["workers"],
        train_seconds=round(directory.seconds(training), 1),
        evaluate_seconds=round(directory.seconds(evaluation), 1),
    )
