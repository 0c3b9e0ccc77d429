"""What a finished run writes: verdicts, figures, the page and `panel.json`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import accumulate
from typing import Any

import msgspec

from integ_gym.evidence.sealing import seal
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError
from integ_gym.support.processes import limit_threads
from integ_gym.support.terminal import WorkBar
from integ_gym.train.policy_files.sidecar import policy_file

from ..report.figures import write_figures
from ..report.page import write_report
from .achieve import tried
from .artefact import as_sealed, build_artefact
from .cells import Home
from .checking.plan import check_records
from .contracts import contracts_in
from .evaluate import evaluated
from .findings import agreements, training_costs
from .matrix import COLUMNS, Matrix, PanelLayout, read_applied, reward_doubts
from .result import Cost, Panel, Policy, Row, RowKind, Stage, write_panel
from .run_directory import CALLED, MANIFEST, RunDirectory, Seen
from .spec import PanelSpec
from .units import training_config, units_of

CHECKING, JUDGING = "checking records", "judging"
DRAWING, WRITING = "drawing figures", "writing the page"

_SECONDS = {CHECKING: 3.0, JUDGING: 9.0, DRAWING: 5.0, WRITING: 3.0}
"""Phases in order, and the time that each takes in the quick panel, s."""

_BEFORE = dict(zip(_SECONDS, accumulate(_SECONDS.values(), initial=0.0), strict=False))

Begin = Callable[[str], None]
"""Called with the name of a phase when it begins."""


@contextmanager
def phases(label: str, shown: bool) -> Iterator[Begin]:
    """A progress bar over judging a finished run; yields what is called as each phase begins.

    The bar is full when the block ends without an error.

    Args:
        label: of the run.
        shown: whether the bar is.
    """
    with WorkBar(f"{label}, verdicts and page", sum(_SECONDS.values()), shown) as bar:

        def begin(phase: str) -> None:
            if _BEFORE[phase] > bar.n:
                bar.update(_BEFORE[phase] - bar.n)
            bar.describe(phase)

        yield begin
        bar.describe("", draw=False)


def write_artefact(
    spec: PanelSpec,
    directory: RunDirectory,
    label: str,
    called: Call,
    progress: bool,
    of: PanelSpec | None = None,
) -> Panel:
    """Reduce the evidence and write ``panel.json``, ``figures/`` and ``report.html``.

    Args:
        spec: the panel, or a stage of it.
        directory: in which all of that is finished.
        label: of the bar.
        called: how the run was called.
        progress: show a bar.
        of: the panel whose stage it is; nothing is decided then.
    """
    with phases(label, progress) as begin:
        begin(CHECKING)
        check_records(directory)
        begin(JUDGING)
        if of is None:
            directory.record_look(describe_look(spec))
        made = panel_of(spec, directory, called, of)
        panel = write_outputs(directory, made, called, begin, decided=of is None)
    directory.storage.send()
    return panel


def panel_of(
    spec: PanelSpec, directory: RunDirectory, called: Call, of: PanelSpec | None = None
) -> Panel:
    """What ``panel.json`` holds of a panel: a function of its plan, markers and records alone.

    Args:
        spec: the panel, or a stage of it.
        directory: in which all of that is finished.
        called: how the run was called.
        of: the panel whose stage it is; nothing is decided then.
    """
    homes = {spec.name_of(home): home for home in spec.train}
    layout, matrix = reduce_records(spec, directory, _rows_of(spec, directory), homes)
    trained = {row.name: row.policy_ids for row in layout.rows if row.kind == "trained"}
    store = EvidenceStore(directory.evidence)
    return artefact_of(
        of or spec,
        directory,
        layout,
        matrix,
        called,
        [unit.training for unit in units_of(spec)],
        training_steps=training_config(spec, units_of(spec)[-1]).total_steps,
        training_costs=training_costs(store, trained),
        engine_agreement=agreements(layout, matrix, spec),
        stage=None if of is None else Stage(seeds=len(spec.seeds), of=len(of.seeds)),
        looks=layout.looks if of is None else (),
        doubts=reward_doubts(spec.env_id, store),
    )


def _rows_of(spec: PanelSpec, directory: RunDirectory) -> tuple[Row, ...]:
    """What was trained, then the baselines, with the hashes that they were evaluated under."""
    homes, there = {spec.name_of(home): home for home in spec.train}, evaluated(directory)
    policies: dict[str, list[Policy]] = {name: [] for name in (*homes, *spec.baselines)}
    for unit in units_of(spec):
        path = policy_file(directory.policies / unit.policy)
        file = path.relative_to(directory.path).as_posix() if unit.home else None
        policy_hash = there[unit.policy].policy_hash
        policy = Policy(id=unit.policy, seed=unit.seed, hash=policy_hash, file=file)
        policies[unit.row].append(policy)
    rows = []
    for name, own in policies.items():
        home = homes.get(name)
        kind: RowKind = "trained" if home else "baseline"
        rows.append(Row.of(name, kind, own, home, spec.shares_of(home)))
    return tuple(rows)


def _units(spec: PanelSpec) -> dict[str, str]:
    """SI units of the arguments that are varied."""
    known = spec.nominal.units()
    varied = {name for one in spec.variations for name in one.changes}
    return {name: known[name] for name in sorted(varied) if known.get(name)}


def describe_look(spec: PanelSpec) -> Seen:
    """What verdicts rest on."""
    trained = set(map(spec.name_of, spec.train))
    natives = sum(cell in trained and cell != row for row, cell in spec.family)
    return Seen(len(spec.seeds), spec.episodes, natives)


def reduce_records(
    spec: PanelSpec,
    directory: RunDirectory,
    rows: tuple[Row, ...],
    homes: Mapping[str, Home],
) -> tuple[PanelLayout, Matrix]:
    """The rows' cells, and what the evaluation episodes on record came to."""
    store = EvidenceStore(directory.evidence)
    table = store.query(f"SELECT {', '.join(COLUMNS)} FROM records WHERE phase = 'evaluation'")
    layout = PanelLayout.of(
        spec, rows, homes, tried(directory), read_applied(store), directory.looks(),
        contracts_in(directory),
    )  # fmt: skip
    return layout, Matrix(rows, table.to_pylist(), spec.episodes, spec.trace_every)


class Call(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How a run was called, as its manifest keeps it.

    Attributes:
        command: how to run it again.
        workers: processes that it ran in.
        directory: where, in words.
    """

    command: str
    workers: int
    directory: str


def read_call(directory: RunDirectory) -> Call:
    """How a run was called when its page was written.

    Raises:
        ValueError: where its manifest does not say so, as those of before it was kept.
    """
    try:
        return msgspec.convert(directory.manifest().get(CALLED), Call)
    except msgspec.ValidationError as error:
        raise InputError(f"its {MANIFEST} does not say how it was called ({error})") from None


def write_outputs(
    directory: RunDirectory,
    made: Panel,
    called: Call,
    begin: Begin,
    decided: bool = True,
) -> Panel:
    """Write ``panel.json`` and the figures, seal the run if it is decided, and write the page.

    Of a sealed run that nothing was added to, ``panel.json`` stays as it is, and so does the seal.

    Args:
        directory: of the finished run.
        made: what was found.
        called: how the run was called.
        begin: called with the name of each phase when it begins.
        decided: whether all of the panel is there.
    """
    panel = as_sealed(directory, made)
    if panel is made:
        directory.note(**{CALLED: msgspec.to_builtins(called)})
        write_panel(panel, directory.path)
    begin(DRAWING)
    write_figures(panel, directory.path / "figures")
    begin(WRITING)
    if decided:
        seal(directory.path)
    write_report(panel, directory.path)
    return panel


def artefact_of(
    spec: PanelSpec,
    directory: RunDirectory,
    layout: PanelLayout,
    matrix: Matrix,
    called: Call,
    training: Sequence[str] = (),
    **found: Any,
) -> Panel:
    """What ``panel.json`` holds.

    Its products are of small matrices: more threads than one take longer, and round otherwise.

    Args:
        spec: the panel.
        directory: of its run.
        layout: rows and cells.
        matrix: outcomes.
        called: how the run was called.
        training: names of the run's training units.
        found: other arguments of :func:`build_artefact`.
    """
    manifest, there = directory.manifest(), evaluated(directory)
    policies = [policy for row in layout.rows for policy in row.policy_ids]
    evaluation = sorted({unit for policy in policies for unit in there[policy].units})
    cost = Cost(
        wall_seconds=round(directory.wall_seconds([*training, *evaluation]), 1),
        workers=called.workers,
        train_seconds=round(directory.seconds(training), 1),
        evaluate_seconds=round(directory.seconds(evaluation), 1),
    )
    with limit_threads():
        return build_artefact(
            layout,
            matrix,
            {policy: own.files for policy, own in there.items()},
            name=spec.name,
            question=manifest["specification"]["question"],
            spec=manifest["specification"],
            protocol_gaps=tuple(spec.gaps()),
            units=_units(spec),
            versions=manifest["versions"],
            command=called.command,
            directory=called.directory,
            cost=cost,
            **found,
        )
