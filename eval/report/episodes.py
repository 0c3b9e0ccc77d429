"""Single episodes for the page: every outcome, the films, and what a browser simulates."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.ops.ops import SCALAR, Array
from integ_gym.envs.registries import ENVIRONMENTS, INTEGRATORS
from integ_gym.envs.settings import NATIVE, Setup
from integ_gym.envs.steps import Script, script_of
from integ_gym.evidence.episodes import COMMANDED, MEASURED
from integ_gym.evidence.labels import SENTENCE_COLUMNS
from integ_gym.evidence.store import EvidenceStore, sql_literal
from integ_gym.train.policy import MlpPolicy
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.reading import read_weights
from integ_gym.train.policy_files.sidecar import WEIGHTS_FILE

from ..film import skeleton_of
from ..panel.conclusions import finding_of
from ..panel.result import Entry, Panel, Policy
from ..power import WITHOUT_VERDICT
from ..verdict import UNSOLVABLE
from .forests import ordered_verdicts
from .task import panel_setup, typical_start, visible_places

LEDGER: Final = ("motor", "numerics", "losses")
"""What adds up to the change of energy, losses taken away."""

MOST_TRACES: Final = 150
"""Traces that a page carries."""

MOST_NUMBERS: Final = 400_000
"""In the traces that a page carries."""

SKELETON_PERIOD: Final = 0.04
"""Time between two samples of a robot's motion, at least, s."""

MOST_SAMPLES: Final = 480
"""Of a trace; of a longer one every n-th is taken."""

MOST_POLICIES: Final = 6
"""Policies whose weights a page carries."""

MOST_CELLS: Final = 24
"""Discretizations that a page simulates."""

ACTIVATIONS: Final = ("Tanh", "ReLU")
"""Of networks that the page's script evaluates."""

_MOST_PAIRS: Final = 8
_MOST_WEIGHTS: Final = 20_000
_FARTHEST: Final = {"rad": 3.1415, "m": 1.0}
"""How far from zero a start may be chosen, by the coordinate's unit."""

_OUTCOMES: Final = """
SELECT policy_id, cell, failure_label AS label, work_total AS motor,
  energy_residual_total AS numerics,
  dissipated_total + coalesce(contact_loss_total, 0) + clip_loss_total AS losses,
  coalesce(time_to_success, 'nan'::DOUBLE) AS "time", episode_index % trace_every = 0 AS traced
FROM records WHERE phase = 'evaluation' ORDER BY policy_id, cell, episode_index
"""
_FIELDS: Final = (
    "record_id", "policy_id", "cell", "episode_index", "success", "failure_label",
    "time_to_success", "return", "energy_start", "energy_end", "length",
    "work_total", "energy_residual_total", "dissipated_total", "contact_loss_total",
    "clip_loss_total", "initial_state", "terminated", "solver_status",
    "command_error", *SENTENCE_COLUMNS,
)  # fmt: skip
_SUMS: Final = ("work", "energy_residual", "dissipated", "contact_loss", "clip_loss")

Kind: TypeAlias = Literal["held", "worst", "failure", "success"]
"""`held`: nothing is lost there, and this start shows it; the others as `choice_words` says."""

Key: TypeAlias = tuple[str, str, int, int]
"""Row, cell, place of the seed, and episode."""


@dataclass(frozen=True)
class Outcomes:
    """What became of the episodes of one entry.

    Attributes:
        label: failure labels, shape (seeds, episodes).
        ledger: J, NaN where it is not known, shape (3, seeds, episodes), as :data:`LEDGER`.
        time: time to success, s, NaN where there is none, shape (seeds, episodes).
        traced: whether a trace was kept, shape (seeds, episodes).
    """

    label: Array
    ledger: Array
    time: Array
    traced: Array


AllOutcomes: TypeAlias = Mapping[tuple[str, str], Outcomes]
"""Row and cell to what became of their episodes."""


@dataclass(frozen=True)
class Lead:
    """An episode worth watching, and where else the same policy ran from the same start.

    Attributes:
        row, cell: names of its row and cell.
        seed: place of its policy in the row.
        episode: place among the policy's starts.
        kind: why it was chosen.
        cells: where it can be watched, its home first, its own cell second.
    """

    row: str
    cell: str
    seed: int
    episode: int
    kind: Kind
    cells: tuple[str, ...]

    @property
    def keys(self) -> list[Key]:
        """Of the episodes that can be watched."""
        return [(self.row, cell, self.seed, self.episode) for cell in self.cells]


@dataclass(frozen=True)
class Trace:
    """An episode to watch.

    Attributes:
        key: which one.
        fields: its record's fields by name.
        period: time between two samples, s.
        motion: coordinates by name, shape (samples,); of a robot also what is measured of its
            command, and the force on its feet.
        control: in force from each sample on, by name, shape (samples,); none of a robot.
        ledger: work of the motor, of the numerics, and losses since the start, J, shape
            (3, samples).
    """

    key: Key
    fields: Mapping[str, Any]
    period: float
    motion: Mapping[str, Array]
    control: Mapping[str, Array]
    ledger: Array
    command: Mapping[str, float] = field(default_factory=dict)
    """What the episode is commanded, by name."""


@dataclass(frozen=True)
class Live:
    """What can be simulated.

    Attributes:
        policies: by row and place of the seed, in the order of the leads.
        scripts: steps by name of the cell, written from the one definition of the physics.
        periods: time between two decisions by name of the cell, s.
        coordinate: place of the coordinate whose start can be chosen.
        reach: the farthest start to either side of zero, in the coordinate's unit.
    """

    policies: Mapping[tuple[str, int], MlpPolicy]
    scripts: Mapping[str, Script]
    periods: Mapping[str, float]
    coordinate: int
    reach: float


@dataclass(frozen=True)
class Episodes:
    """Single episodes of a panel.

    Attributes:
        outcomes: of every episode, by row and cell.
        leads: what is worth watching, the most informative first.
        traces: of the leads.
        live: what can be simulated anew; None where nothing can.
        skeleton: of which a robot is drawn, see
            :func:`integ_gym.envs.testbeds.mjcf_model.describe_skeleton`; None: no robot.
    """

    outcomes: AllOutcomes
    leads: Sequence[Lead]
    traces: Sequence[Trace]
    live: Live | None = None
    skeleton: Mapping[str, Any] | None = None


def read_episodes(panel: Panel, directory: str | PathLike[str]) -> Episodes | None:
    """Episodes of a panel from the evidence in its directory; None where none is beside it.

    Raises:
        EvidenceError: for evidence that cannot be read.
    """
    store = EvidenceStore(Path(directory) / "evidence")
    if not store.files():
        return None
    outcomes = _read_outcomes(panel, store)
    skeleton = _read_skeleton(store)
    names = _trace_columns(panel, store, skeleton)
    duration = max(1.0, float(panel.spec.get("environment", {}).get("duration") or 10.0))
    periods = [cell.control_period for cell in panel.columns] or [duration]
    samples = min(MOST_SAMPLES, duration / min(periods))
    if skeleton is not None:
        samples = duration / SKELETON_PERIOD
    numbers = samples * (len(names.motion) + len(names.control) + len(LEDGER))
    leads = choose_episodes(panel, outcomes, min(MOST_TRACES, max(4, int(MOST_NUMBERS / numbers))))
    traces = _read_traces(panel, store, leads, names)
    there = {trace.key for trace in traces}
    shown = [lead for lead in leads if (lead.row, lead.cell, lead.seed, lead.episode) in there]
    policies: dict[tuple[str, int], MlpPolicy] = {}
    for row, seed in dict.fromkeys((lead.row, lead.seed) for lead in shown):
        if len(policies) < MOST_POLICIES:
            policy = read_network(panel.row(row).policies[seed], Path(directory))
            policies |= {} if policy is None else {(row, seed): policy}
    return Episodes(outcomes, shown, traces, live_of(panel, shown, policies), skeleton)


def _read_skeleton(store: EvidenceStore) -> Mapping[str, Any] | None:
    first = "SELECT engine_description FROM records WHERE phase = 'evaluation' LIMIT 1"
    records = store.query(first).to_pylist()
    return skeleton_of(records[0]) if records else None


def _robot_columns(skeleton: Mapping[str, Any], names: Iterable[str]) -> list[str]:
    """Trace columns that a robot is drawn from: of these names, what is measured, too."""
    measured = (name for name in names if name.startswith(MEASURED))
    forces = (f"{foot}_normal_force" for foot in skeleton["feet"])
    return [*skeleton["coordinates"], *measured, *forces]


def _read_outcomes(panel: Panel, store: EvidenceStore) -> dict[tuple[str, str], Outcomes]:
    """Outcomes of the entries whose episodes are all on record."""
    table = store.query(_OUTCOMES)
    columns = {
        name: table.column(name).to_numpy(zero_copy_only=False) for name in table.column_names
    }
    policies, cells = columns["policy_id"], columns["cell"]
    changes = (policies[1:] != policies[:-1]) | (cells[1:] != cells[:-1])
    edges = [0, *(np.flatnonzero(changes) + 1), len(cells)] if len(cells) else []
    slices = {(policies[a], cells[a]): slice(a, b) for a, b in itertools.pairwise(edges)}
    outcomes = {}
    for entry in panel.matrix:
        ids = [policy.id for policy in panel.row(entry.row).policies]
        own = [slices.get((name, entry.cell), slice(0, 0)) for name in ids]
        if not own or len(sizes := {part.stop - part.start for part in own}) != 1 or sizes == {0}:
            continue
        stacked = {name: np.stack([columns[name][part] for part in own]) for name in columns}
        outcomes[entry.row, entry.cell] = Outcomes(
            stacked["label"].astype(str),
            np.stack([stacked[name].astype(float) for name in LEDGER]),
            stacked["time"].astype(float),
            stacked["traced"].astype(bool),
        )
    return outcomes


def choose_episodes(panel: Panel, outcomes: AllOutcomes, most: int = MOST_TRACES) -> list[Lead]:
    """Leads, that of the answer's first line before all others, then the most informative.

    They have at most ``most`` traces in all.
    """
    leads: list[Lead] = []
    keys: set[Key] = set()
    per_pair = [list(_leads(panel, pair, outcomes)) for pair in _pairs(panel, outcomes)]
    for depth in range(3):
        for lead in (own[depth] for own in per_pair if len(own) > depth):
            if len(keys.union(lead.keys)) <= most:
                keys.update(lead.keys)
                leads.append(lead)
    pairs = list(dict.fromkeys((lead.row, lead.cell) for lead in leads))
    return sorted(leads, key=lambda lead: pairs.index((lead.row, lead.cell)))


def choice_words(panel: Panel) -> str:
    """What is chosen, in words."""
    cells = "of every cell of the declared family"
    if not panel.verdicts:
        cells = f"of the {_MOST_PAIRS} cells in which most success is lost"
    where = "" if panel.yardstick is None else f", {panel.at_yardstick}"
    return (
        f"{cells}: the worst start of the seed that loses most, the median failure and the median "
        f"success; each with the same policy and start at home{where} and on every integrator at "
        "its coarsest step"
    )


def _pairs(panel: Panel, outcomes: AllOutcomes) -> list[tuple[str, str]]:
    """Row and cell that the first line of the answer speaks of, then the declared family.

    Of that what can be judged comes first; without any such, the largest losses do.
    """
    judged = ordered_verdicts(panel)
    informative = [one for one in judged if one.verdict not in WITHOUT_VERDICT]
    informative.sort(key=lambda one: -one.overfitting.estimate)
    pairs = [(one.row, one.cell) for one in (*informative, *judged)]
    if not informative:
        lost = panel.exploratory or _largest_drops(panel)
        pairs = [*((entry.row, entry.cell) for entry in lost), *pairs]
    finding = finding_of(panel)
    if finding is not None and finding.cell not in (None, _home(panel, finding.row)):
        pairs = [(finding.row, finding.cell), *pairs]
    return [pair for pair in dict.fromkeys(pairs) if pair in outcomes][:_MOST_PAIRS]


def _largest_drops(panel: Panel) -> list[Entry]:
    """From home or the truth, whichever is higher, where somebody succeeds in time first."""
    varied = (cell for cell in panel.cells if cell.kind == "varied")
    shown = {cell.name for cell in (*panel.columns, *varied)}

    def order(entry: Entry) -> tuple[bool, float]:
        home = panel.entry(entry.row, _home(panel, entry.row) or "")
        best = [e.success.estimate for e in (home, panel.on_yardstick(entry.row)) if e is not None]
        return _is_unsolvable(panel, entry.cell), entry.success.estimate - max(best, default=0.0)

    entries = [e for e in panel.matrix if e.cell in shown and not panel.row(e.row).baseline]
    return sorted(entries, key=order)[:3]


def _home(panel: Panel, row: str) -> str | None:
    """Name of a row's home, or of the first member of its mixture."""
    return panel.row(row).home or next(iter(panel.row(row).shares), None)


def _is_unsolvable(panel: Panel, cell: str) -> bool:
    """Whether no policy succeeds in a cell in time: then it judges the simulator."""
    return panel.cell(cell).achievability in UNSOLVABLE


def _leads(panel: Panel, pair: tuple[str, str], outcomes: AllOutcomes) -> Iterator[Lead]:
    """A start that holds where nothing is lost; the worst, a median failure and success."""
    own, home = outcomes[pair], outcomes.get((pair[0], _home(panel, pair[0]) or ""))
    success = own.label == "none"
    at_home = np.ones_like(success) if home is None else home.label == "none"
    # By how much the energy from the numerics differs from that at home, J.
    pump = np.nan_to_num(np.abs(own.ledger[1] - (0.0 if home is None else home.ledger[1])))
    seed = int(np.argmax(at_home.mean(axis=1) - success.mean(axis=1)))
    failed = ~success[seed] & own.traced[seed]
    failed = failed & at_home[seed] if (failed & at_home[seed]).any() else failed
    finding = finding_of(panel)
    holds = finding is not None and (
        (finding.row, finding.cell) == pair
        and finding.status in ("not_cause", "gained", "home_decides")
    )
    worst = (seed, int(np.argmax(np.where(failed, pump[seed], -1.0)))) if failed.any() else None
    places: dict[Kind, tuple[int, int] | None] = {
        "held": _median(success & at_home & own.traced, own.time) if holds else None,
        "worst": worst,
        "failure": _median(~success & own.traced, pump),
        "success": _median(success & own.traced, own.time),
    }
    shown = set()
    for kind, place in places.items():
        if place is not None and place not in shown:
            shown.add(place)
            yield Lead(*pair, *place, kind, _cells_of_lead(panel, pair, outcomes, place))


def _median(wanted: Array, by: Array) -> tuple[int, int] | None:
    """Seed and episode of the lower median among those that are wanted."""
    places = np.argwhere(wanted)
    if not len(places):
        return None
    order = np.argsort(np.nan_to_num(by[wanted]), kind="stable")
    seed, episode = places[order[(len(order) - 1) // 2]]
    return int(seed), int(episode)


def _cells_of_lead(
    panel: Panel, pair: tuple[str, str], outcomes: AllOutcomes, place: tuple[int, int]
) -> tuple[str, ...]:
    """Home, the cell, the truth, every integrator at its coarsest step, the worst varied cell.

    Behind the first two, what differs from both comes first: another ending than home's, and among
    those what the numerics gave or took most. Cells in which no policy succeeds in time come last.
    """
    row, cell = pair
    truth = panel.yardstick.name if panel.yardstick else None
    varied = [e for e in panel.matrix if e.row == row and panel.cell(e.cell).kind == "varied"]
    worst = min(varied, key=lambda entry: entry.success.estimate, default=None)
    coarsest = (group.cells[0].name for group in panel.groups)
    wanted = (_home(panel, row), cell, truth, *coarsest, worst and worst.cell)
    first, *others = dict.fromkeys(
        name for name in wanted if name and panel.entry(row, name) is not None
    )

    def order(name: str) -> tuple[bool, bool, bool, float]:
        own = outcomes.get((row, name))
        if own is None:
            return name != cell, True, True, 0.0
        size = float(np.nan_to_num(abs(own.ledger[1][place])))
        succeeds = bool(own.label[place] == "none")
        return name != cell, _is_unsolvable(panel, name), succeeds, -size

    return (first, *sorted(others, key=order))


class _Columns(NamedTuple):
    """Names of columns of a trace, and the skeleton of a robot."""

    motion: list[str]
    control: list[str]
    commands: list[str]
    skeleton: Mapping[str, Any] | None = None


def _trace_columns(
    panel: Panel, store: EvidenceStore, skeleton: Mapping[str, Any] | None
) -> _Columns:
    """What is shown: coordinates that can be seen, and controls, or what a robot is drawn from."""
    names = store.query("DESCRIBE records").column("column_name").to_pylist()
    after = names[names.index("time") + 1 :]
    if skeleton is not None:
        commands = [name for name in after if name.startswith(COMMANDED)]
        return _Columns(_robot_columns(skeleton, after), [], commands, skeleton)
    control = [name for name in after if name.endswith("_applied")][:2]
    setup = panel_setup(panel)
    if setup is not None:
        places = visible_places(setup.plant)
        return _Columns([setup.plant.coordinates[k] for k in places], control, [])
    states = itertools.takewhile(lambda name: not name.startswith("sensed_"), after)
    return _Columns([name for name in states if not name.endswith("_dot")][:4], control, [])


def _read_traces(
    panel: Panel, store: EvidenceStore, leads: Iterable[Lead], names: _Columns
) -> list[Trace]:
    """The traces that the leads ask for, in their order; without those that were not kept."""
    keys = list(dict.fromkeys(key for lead in leads for key in lead.keys))
    if not keys:
        return []
    wanted = {(panel.row(r).policies[s].id, c, e): (r, c, s, e) for r, c, s, e in keys}
    columns = ", ".join(
        '"' + name.replace('"', '""') + '"'
        for name in (*_FIELDS, "time", *names.motion, *names.control, *names.commands, *_SUMS)
    )
    where = " AND ".join(
        f"{name} IN ({', '.join(sorted({sql_literal(key[place]) for key in wanted}))})"
        for place, name in enumerate(("policy_id", "cell", "episode_index"))
    )
    table = store.query(f"SELECT {columns} FROM records WHERE phase = 'evaluation' AND {where}")
    traces = {}
    for record in table.to_pylist():
        key = wanted.get((record["policy_id"], record["cell"], record["episode_index"]))
        if key is not None and record["time"] and record["length"]:
            traces[key] = _trace(key, record, names)
    return [traces[key] for key in keys if key in traces]


def _trace(key: Key, record: Mapping[str, Any], names: _Columns) -> Trace:
    motion, control, commands, skeleton = names
    length = record["length"]
    every = -(-(length + 1) // MOST_SAMPLES)
    if skeleton is not None:
        every = max(every, round(SKELETON_PERIOD / record["control_period"]))
    instants = skeleton["coordinates"] if skeleton is not None else motion
    shown = np.arange(0, length + 1, every)

    def samples(name: str, count: int) -> Array:
        """Finite numbers, the last one known where there is none."""
        values = _floats(record[name], count)
        known = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(count), 0))
        return np.nan_to_num(values[known], posinf=0.0, neginf=0.0)

    def total(name: str) -> Array:
        """Amounts since the start, J."""
        steps = np.nan_to_num(_floats(record[name], length), posinf=0.0, neginf=0.0)
        return np.concatenate(([0.0], np.cumsum(steps)))

    sums = [total(name) for name in _SUMS]
    return Trace(
        key,
        {name: record[name] for name in _FIELDS},
        record["control_period"] * every,
        {
            name: samples(name, length + 1)[shown]
            if name in instants
            else samples(name, length)[np.maximum(shown - 1, 0)]  # at the end of a step
            for name in motion
        },
        # The last one stays in force at the end.
        {name: samples(name, length)[np.minimum(shown, length - 1)] for name in control},
        np.stack((sums[0], sums[1], sums[2] + sums[3] + sums[4]))[:, shown],
        {name.removeprefix(COMMANDED): record[name][0] for name in commands},
    )


def _floats(values: Sequence[float | None] | None, count: int) -> Array:
    """So many numbers, NaN where there is none."""
    numbers = np.array([np.nan if x is None else x for x in (values or ())][:count], float)
    return np.concatenate((numbers, np.full(count - len(numbers), np.nan)))


def read_network(judged: Policy, directory: Path) -> MlpPolicy | None:
    """The network of a policy, if it is the one that the panel judged and a page can carry it."""
    if not judged.file:
        return None
    file = directory / judged.file
    statistics = next(file.parent.glob("obs_stats.*"), None)
    for path in (file.with_name(WEIGHTS_FILE), file):
        with suppress(OSError, ValueError, PolicyFileError, ModuleNotFoundError):
            card = path.with_suffix(".json")
            beside = json.loads(card.read_text("utf-8")) if card.exists() else None
            policy = read_weights(path, beside, statistics)
            if policy.content_hash == judged.hash:
                if not isinstance(policy, MlpPolicy) or policy.activation not in ACTIVATIONS:
                    return None
                size = sum(weight.size for weight, _ in policy.layers)
                return policy if size <= _MOST_WEIGHTS else None
    return None


def live_of(
    panel: Panel, leads: Iterable[Lead], policies: Mapping[tuple[str, int], MlpPolicy]
) -> Live | None:
    """What can be simulated with these policies; None if nothing can.

    That is on native cells without a variation: those of the leads first, then from coarse to
    fine.
    """
    env_id = str(panel.spec.get("env_id"))
    if not policies or env_id not in ENVIRONMENTS:
        return None
    asked = [name for lead in leads for name in lead.cells]
    others = sorted(panel.columns, key=lambda cell: -cell.dt)
    scripts: dict[str, Script] = {}
    setup, periods = None, {}
    for name in dict.fromkeys([*asked, *(cell.name for cell in others)]):
        cell = panel.cell(name)
        known = cell.engine == NATIVE and cell.integrator in INTEGRATORS.names()
        if not known or cell.kind == "varied" or len(scripts) == MOST_CELLS:
            continue
        try:
            own = environment_setup(env_id, cell.arguments(panel.spec.get("environment", {})))
        except (TypeError, ValueError):
            continue
        if script := script_of(own):
            setup, scripts[name], periods[name] = own, script, cell.control_period
    if setup is None:
        return None
    units = setup.plant.coordinate_units
    coordinate = units.index("rad") if "rad" in units else 0
    return Live(policies, scripts, periods, coordinate, _reach(setup, coordinate))


def _reach(setup: Setup, place: int) -> float:
    """How far a coordinate may be from zero, the others at rest at a start, without an end."""
    (usual, _), rest = typical_start(setup), (0.0,) * len(setup.plant.coordinates)
    farthest = _FARTHEST.get(setup.plant.coordinate_units[place], 1.0)
    for k in range(100, 0, -1):
        start = (*usual[:place], farthest * k / 100, *usual[place + 1 :])
        if not setup.task.terminated(SCALAR, start, rest):
            return farthest * k / 100
    return 0.0
