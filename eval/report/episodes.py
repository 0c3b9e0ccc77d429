"""Single episodes for the page: every outcome, some traces, and what a browser simulates."""

from __future__ import annotations

import inspect
import itertools
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from integ_gym.envs.catalogue.lookup import environment_setup, is_integ_environment
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import ENVIRONMENTS, INTEGRATORS
from integ_gym.envs.settings import NATIVE, Setup
from integ_gym.envs.steps import Script, script_of
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.evidence.labels import SENTENCE_COLUMNS
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy import MlpPolicy
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.reading import read_weights
from integ_gym.train.policy_files.sidecar import WEIGHTS_FILE

from ..panel.conclusions import finding_of
from ..panel.result import Cell, Entry, Panel, Policy
from ..power import WITHOUT_VERDICT
from ..verdict import UNSOLVABLE
from .forests import ordered_verdicts

Array = npt.NDArray[Any]

LEDGER: Final = ("motor", "numerics", "losses")
"""What adds up to the change of energy, losses taken away."""

_SQL: Final = """
SELECT policy_id, cell, episode_index, failure_label AS label, work_total AS motor,
  energy_residual_total AS numerics,
  dissipated_total + coalesce(contact_loss_total, 0) + clip_loss_total AS losses,
  coalesce(time_to_success, 'nan'::DOUBLE) AS "time", episode_index % trace_every = 0 AS traced
FROM records WHERE phase = 'evaluation'
"""


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


def outcomes_of(panel: Panel, store: EvidenceStore) -> dict[tuple[str, str], Outcomes]:
    """Outcomes by row and cell, of the entries whose episodes are all on record."""
    table = store.query(_SQL)
    columns = {name: table.column(name).to_numpy(zero_copy_only=False) for name in
               table.column_names}  # fmt: skip
    order = np.lexsort((columns["episode_index"], columns["policy_id"], columns["cell"]))
    columns = {name: values[order] for name, values in columns.items()}
    groups = _groups(columns["policy_id"], columns["cell"])
    found = {}
    for entry in panel.matrix:
        own = _stacked(panel, entry, groups, columns)
        if own is not None:
            found[entry.row, entry.cell] = own
    return found


def _groups(policies: Array, cells: Array) -> dict[tuple[str, str], slice]:
    """Where the episodes of each policy and cell stand, neighbours as they are."""
    found: dict[tuple[str, str], slice] = {}
    start = 0
    for (policy, cell), own in itertools.groupby(zip(policies, cells, strict=True)):
        end = start + sum(1 for _ in own)
        found[str(policy), str(cell)] = slice(start, end)
        start = end
    return found


def _stacked(
    panel: Panel,
    entry: Entry,
    groups: Mapping[tuple[str, str], slice],
    columns: Mapping[str, Array],
) -> Outcomes | None:
    policies = panel.row(entry.row).policies
    slices = [groups.get((policy.id, entry.cell)) for policy in policies]
    sizes = {0 if found is None else found.stop - found.start for found in slices}
    if not policies or len(sizes) != 1 or sizes == {0}:
        return None

    def stacked(name: str) -> Array:
        return np.stack([columns[name][found] for found in slices])

    ledger = np.stack([stacked(name).astype(np.float64) for name in LEDGER])
    return Outcomes(
        stacked("label").astype(str), ledger, stacked("time").astype(float),
        stacked("traced").astype(bool),
    )  # fmt: skip


Kind: TypeAlias = Literal["held", "worst", "failure", "success"]
"""`held`: nothing is lost there, and this start shows it; the others as `chosen_words` says."""

MOST_TRACES: Final = 150
"""Traces that a page carries."""

_MOST_PAIRS: Final = 8


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


def chosen(panel: Panel, outcomes: Mapping[tuple[str, str], Outcomes]) -> list[Lead]:
    """Leads, that of the answer's first line before all others, then the most informative.

    They have at most :data:`MOST_TRACES` traces in all.
    """
    leads: list[Lead] = []
    traces: set[tuple[str, str, int, int]] = set()
    per_pair = [list(_leads(panel, pair, outcomes)) for pair in _pairs(panel, outcomes)]
    for depth in range(3):
        for found in per_pair:
            for lead in found[depth : depth + 1]:
                more = {(lead.row, cell, lead.seed, lead.episode) for cell in lead.cells}
                if len(traces | more) <= MOST_TRACES:
                    traces |= more
                    leads.append(lead)
    pairs = list(dict.fromkeys((lead.row, lead.cell) for lead in leads))
    return sorted(leads, key=lambda lead: pairs.index((lead.row, lead.cell)))


def chosen_words(panel: Panel) -> str:
    """What is chosen, in words."""
    cells = "of every cell of the declared family"
    if not panel.verdicts:
        cells = f"of the {_MOST_PAIRS} cells in which most success is lost"
    return (
        f"{cells}: the worst start of the seed that loses most, the median failure and the median "
        "success; each with the same policy and start at home, on the truth and on every "
        "integrator at its coarsest step"
    )


def _pairs(panel: Panel, outcomes: Mapping[tuple[str, str], Outcomes]) -> list[tuple[str, str]]:
    """What the first line of the answer speaks of, then the declared family.

    Of that what can be judged comes first; without any such, the largest losses do.
    """
    judged = ordered_verdicts(panel)
    informative = [one for one in judged if one.verdict not in WITHOUT_VERDICT]
    informative.sort(key=lambda one: -one.overfitting.estimate)
    pairs = [(one.row, one.cell) for one in (*informative, *judged)]
    if not informative:
        lost = [(entry.row, entry.cell) for entry in panel.exploratory]
        pairs = [*(lost or _largest_drops(panel)), *pairs]
    finding = finding_of(panel)
    if finding is not None and finding.cell is not None:
        pairs = [(finding.row, finding.cell), *pairs]
    return [pair for pair in dict.fromkeys(pairs) if pair in outcomes][:_MOST_PAIRS]


def _largest_drops(panel: Panel) -> list[tuple[str, str]]:
    columns = {cell.name for cell in panel.columns}

    def drop(entry: Entry) -> float:
        others = [
            other.success.estimate
            for cell in (_home(panel, entry.row), panel.truth and panel.truth.name)
            if cell and (other := panel.entry(entry.row, cell)) is not None
        ]
        return max(others, default=0.0) - entry.success.estimate

    entries = [
        entry
        for entry in panel.matrix
        if entry.cell in columns and not panel.row(entry.row).baseline
    ]
    entries.sort(key=lambda entry: (_unsolvable(panel, entry.cell), -drop(entry)))
    return [(entry.row, entry.cell) for entry in entries[:3]]


def _unsolvable(panel: Panel, cell: str) -> bool:
    """Whether nobody succeeds in a cell in time: then it judges the simulator."""
    return panel.cell(cell).achievability in UNSOLVABLE


def _leads(
    panel: Panel, pair: tuple[str, str], outcomes: Mapping[tuple[str, str], Outcomes]
) -> Iterator[Lead]:
    own, home = outcomes[pair], outcomes.get((pair[0], _home(panel, pair[0]) or ""))
    success = own.label == "none"
    at_home = np.ones_like(success) if home is None else home.label == "none"
    pump = _pump(own, home)
    seed = int(np.argmax(at_home.mean(axis=1) - success.mean(axis=1)))
    worst = _worst(~success[seed], at_home[seed], own.traced[seed], pump[seed])

    def lead(place: tuple[int, int], kind: Kind) -> Lead:
        return Lead(*pair, *place, kind, _cells(panel, pair, outcomes, place))

    taken = set()
    held = _median(success & at_home & own.traced, own.time) if _holds(panel, pair) else None
    if held is not None:
        taken.add(held)
        yield lead(held, "held")
    if worst is not None and (seed, worst) not in taken:
        taken.add((seed, worst))
        yield lead((seed, worst), "worst")
    kinds: tuple[tuple[Kind, Array, Array], ...] = (
        ("failure", ~success, pump),
        ("success", success, own.time),
    )
    for kind, wanted, by in kinds:
        place = _median(wanted & own.traced, by)
        if place is not None and place not in taken:
            yield lead(place, kind)


def _holds(panel: Panel, pair: tuple[str, str]) -> bool:
    """Whether the answer's first line says of a pair that nothing is lost."""
    finding = finding_of(panel)
    if finding is None or (finding.row, finding.cell) != pair:
        return False
    return finding.status in ("not_cause", "gained", "home_decides")


def _worst(failed: Array, at_home: Array, traced: Array, pump: Array) -> int | None:
    """A failure that succeeds at home, if there is one, in which the numerics differ by most."""
    wanted = failed & traced
    wanted = wanted & at_home if (wanted & at_home).any() else wanted
    return int(np.argmax(np.where(wanted, pump, -1.0))) if wanted.any() else None


def _pump(own: Outcomes, home: Outcomes | None) -> Array:
    """By how much the energy from the numerics differs from that at home, J."""
    at_home = 0.0 if home is None else home.ledger[1]
    difference: Array = np.nan_to_num(np.abs(own.ledger[1] - at_home))
    return difference


def _median(wanted: Array, by: Array) -> tuple[int, int] | None:
    places = np.argwhere(wanted)
    if not len(places):
        return None
    order = np.argsort(np.nan_to_num(by[wanted]), kind="stable")
    seed, episode = places[order[(len(order) - 1) // 2]]
    return int(seed), int(episode)


def _home(panel: Panel, row: str) -> str | None:
    """Name of a row's home, or of the first member of its mixture."""
    return panel.row(row).home or next(iter(panel.row(row).shares), None)


def _cells(
    panel: Panel,
    pair: tuple[str, str],
    outcomes: Mapping[tuple[str, str], Outcomes],
    place: tuple[int, int],
) -> tuple[str, ...]:
    """Home, the cell itself, the truth, and every integrator at its coarsest step.

    Behind the first two, what differs from both comes first: another ending than home's, and among
    those what the numerics gave or took most. Where nobody succeeds in time comes last.
    """
    row, cell = pair
    truth = panel.truth.name if panel.truth else None
    wanted = (_home(panel, row), cell, truth, *(group.cells[0].name for group in panel.groups))
    first, *others = dict.fromkeys(
        name for name in wanted if name and panel.entry(row, name) is not None
    )

    def telling(name: str) -> tuple[bool, bool, float]:
        own = outcomes.get((row, name))
        if own is None:
            return True, True, 0.0
        size = float(np.nan_to_num(abs(own.ledger[1][place])))
        return _unsolvable(panel, name), bool(own.label[place] == "none"), -size

    head = [name for name in others if name == cell]
    tail = sorted((name for name in others if name != cell), key=telling)
    return (first, *head, *tail)


MOST_POLICIES: Final = 6
"""Policies whose weights a page carries."""

MOST_CELLS: Final = 24
"""Discretizations that a page simulates."""

ACTIVATIONS: Final = ("Tanh", "ReLU")
"""Of networks that the page's script evaluates."""

_MOST_WEIGHTS: Final = 20_000
_FARTHEST: Final = {"rad": 3.1415, "m": 1.0}
"""How far from zero a start may be chosen, by the coordinate's unit."""


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


def live_of(panel: Panel, leads: Iterable[Lead], directory: Path) -> Live | None:
    """What can be simulated of a panel in a directory; None if nothing can."""
    leads = list(leads)
    policies = dict(_policies(panel, leads, directory))
    return with_policies(panel, leads, policies)


def with_policies(
    panel: Panel, leads: Iterable[Lead], policies: Mapping[tuple[str, int], MlpPolicy]
) -> Live | None:
    """As :func:`live_of`, with these policies."""
    if not policies:
        return None
    scripts: dict[str, Script] = {}
    setup, periods = None, {}
    for cell in _cells_live(panel, leads):
        made = _setup(panel, cell)
        script = made and script_of(made)
        if made and script:
            scripts[cell.name], setup = script, made
            periods[cell.name] = cell.control_period
        if len(scripts) == MOST_CELLS:
            break
    if setup is None:
        return None
    units = setup.plant.coordinate_units
    coordinate = units.index("rad") if "rad" in units else 0
    return Live(policies, scripts, periods, coordinate, _reach(setup, coordinate))


def _policies(
    panel: Panel, leads: Iterable[Lead], directory: Path
) -> Iterator[tuple[tuple[str, int], MlpPolicy]]:
    """Policies of the leads that are simple networks, as long as there is room."""
    places = dict.fromkeys((lead.row, lead.seed) for lead in leads)
    found = 0
    for row, seed in places:
        policy = policy_read(panel.row(row).policies[seed], directory)
        if policy is not None and found < MOST_POLICIES:
            found += 1
            yield (row, seed), policy


def policy_read(told: Policy, directory: Path) -> MlpPolicy | None:
    """The network of a policy, if it is the one that the panel judged."""
    if not told.file:
        return None
    kept = directory / told.file
    statistics = next(kept.parent.glob("obs_stats.*"), None)
    for path in (kept.with_name(WEIGHTS_FILE), kept):
        with suppress(OSError, ValueError, PolicyFileError, ModuleNotFoundError):
            card = path.with_suffix(".json")
            beside = json.loads(card.read_text("utf-8")) if card.exists() else None
            policy = read_weights(path, beside, statistics)
            if policy.content_hash == told.hash:
                return policy if isinstance(policy, MlpPolicy) and _is_simple(policy) else None
    return None


def _is_simple(policy: MlpPolicy) -> bool:
    size = sum(weight.size for weight, _ in policy.layers)
    return policy.activation in ACTIVATIONS and size <= _MOST_WEIGHTS


def _cells_live(panel: Panel, leads: Iterable[Lead]) -> list[Cell]:
    """Native cells without a perturbation: those of the leads first, then from coarse to fine."""
    asked = dict.fromkeys(name for lead in leads for name in lead.cells)
    others = sorted(panel.columns, key=lambda cell: -cell.dt)
    names = dict.fromkeys([*asked, *(cell.name for cell in others)])
    known = INTEGRATORS.names()
    cells = [panel.cell(name) for name in names]
    return [
        cell
        for cell in cells
        if cell.engine == NATIVE and cell.integrator in known and cell.perturbation is None
    ]


def _setup(panel: Panel, cell: Cell) -> Setup | None:
    env_id = panel.spec.get("env_id")
    if env_id not in ENVIRONMENTS:
        return None
    chosen = {
        name: getattr(cell, name) for name in ("engine", "integrator", "dt", "control_period")
    }
    with suppress(TypeError, ValueError):
        return environment_setup(env_id, {**panel.spec.get("environment", {}), **chosen})
    return None


def _reach(setup: Setup, place: int) -> float:
    """How far a coordinate may be from zero, the others at rest there, without an end."""
    count = len(setup.plant.coordinates)
    farthest = _FARTHEST.get(setup.plant.coordinate_units[place], 1.0)

    def goes_on(distance: float) -> bool:
        q = tuple(distance if k == place else 0.0 for k in range(count))
        return not setup.task.terminated(SCALAR, q, (0.0,) * count)

    if goes_on(farthest):
        return farthest
    steps = 100
    return max((farthest * k / steps for k in range(steps) if goes_on(farthest * k / steps)),
               default=0.0)  # fmt: skip


_FARTHEST_TRACES: Final = {"rad": math.pi, "m": 10.0}
"""How far from zero the edge of the goal is sought, by a coordinate's unit."""


@dataclass(frozen=True)
class TaskWords:
    """What a policy is asked to do.

    Attributes:
        lead: the task in a sentence.
        facts: (name, words) of goal, motor, decisions and episode.
        scene: links, goal and limits to draw, fit for JSON; None where the plant does not tell
            its shape.
    """

    lead: str
    facts: tuple[tuple[str, str], ...]
    scene: dict[str, Any] | None


def task_words(panel: Panel) -> TaskWords | None:
    """The task of a panel; None of one that only code of a user's own can tell of."""
    setup = _setup_traces(panel)
    if setup is None:
        return _told_by_its_testbed(panel)
    return TaskWords(_lead(setup), tuple(_facts(setup)), _scene(setup))


def _told_by_its_testbed(panel: Panel) -> TaskWords | None:
    """Goal and control period of one of Gymnasium's own tasks; None where it is not installed."""
    env_id = str(panel.spec.get("env_id"))
    if env_id not in gym.registry:
        return None
    try:
        goal = find_testbed(env_id, panel.spec.get("environment", {})).success.goal
    except ModuleNotFoundError:
        return None
    facts = [("goal", goal)]
    if panel.columns and not panel.mixed_periods:
        facts.append(("decisions", _decisions(panel.columns[0].control_period)))
    return TaskWords(f"{env_id} of Gymnasium.", tuple(facts), None)


def _decisions(control_period: float) -> str:
    return f"one every {control_period:g} s, held in between"


def _setup_traces(panel: Panel) -> Setup | None:
    env_id, given = str(panel.spec.get("env_id")), panel.spec.get("environment", {})
    if not is_integ_environment(env_id):
        return None
    periods = [cell.control_period for cell in panel.columns]
    chosen = {"dt": periods[0], "control_period": periods[0]} if periods else {}
    return environment_setup(env_id, {**given, **chosen})


def _lead(setup: Setup) -> str:
    module = inspect.getmodule(type(setup.task))
    return (inspect.getdoc(module) or setup.task.goal).splitlines()[0]


def _facts(setup: Setup) -> list[tuple[str, str]]:
    plant, timing = setup.plant, setup.timing
    limit = f"{plant.control_name} up to ±{_limit(setup):g} {plant.control_unit}"
    gravity = getattr(plant, "gravity_torque", None)
    if gravity is not None:
        limit += f"; gravity pulls with up to {float(np.max(gravity)):g} {plant.control_unit}"
    return [
        ("goal", _goal(setup)),
        ("motor", limit),
        ("decisions", _decisions(timing.control_period)),
        ("episode", f"{setup.settings.duration:g} s, start: {setup.settings.start}"),
    ]


def _goal(setup: Setup) -> str:
    words = setup.task.goal.replace("theta", "θ")
    return words.replace("`duration`", f"{setup.settings.duration:g} s")


def _limit(setup: Setup) -> float:
    return float(np.max(setup.task.control_limit))


def _scene(setup: Setup) -> dict[str, Any] | None:
    plant = setup.plant
    links = _links(plant)
    bob = None if links else _bob(plant)
    if not (links or bob):
        return None
    return {
        "coordinates": list(plant.coordinates),
        "units": list(plant.coordinate_units),
        "links": links,
        "bob": bob,
        "clockwise": "counter-clockwise" not in plant.frame,
        "goal": [_half_goal(setup, place) for place in range(len(plant.coordinates))],
        "pose": _pose(setup),
        "control": plant.control_name,
        "unit": plant.control_unit,
        "actuated": plant.actuated,
        "limit": _limit(setup),
        "upright": _goal_energy(setup),
    }


def _pose(setup: Setup) -> list[float]:
    """Coordinates to draw the task in: part of the way up, or near the goal if it ends there."""
    plant = setup.plant
    angles = [unit == "rad" for unit in plant.coordinate_units]
    swinging = tuple(2.2 if angle else 0.0 for angle in angles)
    if not setup.task.terminated(SCALAR, swinging, (0.0,) * len(swinging)):
        return list(swinging)
    return [0.5 * (_half_goal(setup, k) or 0.2) if angle else 0.0 for k, angle in enumerate(angles)]


def _goal_energy(setup: Setup) -> float:
    """Energy at rest at the goal, J; zero where the goal is not at zero."""
    rest = (0.0,) * len(setup.plant.coordinates)
    return round(float(np.max(setup.plant.energy(SCALAR, rest, rest))), 6)


def _links(plant: Any) -> list[dict[str, Any]]:
    """Joint and length of every link; the length of a uniform one is twice its centre's."""
    mechanism = getattr(plant, "mechanism", None)
    return [
        {
            "joint": link.joint,
            "point": float(np.max(link.inertia)) == 0.0,
            "length": float(np.max(link.centre)) * (2.0 if np.max(link.inertia) else 1.0),
        }
        for link in (mechanism.links if mechanism else ())
    ]


def _bob(plant: Any) -> dict[str, Any] | None:
    """A point that moves in a plane, below the pivot of its spring; None of any other plant."""
    if tuple(plant.coordinate_units) != ("m", "m") or not hasattr(plant, "hanging_length"):
        return None
    return {"pivot": float(np.max(plant.hanging_length))}


def _half_goal(setup: Setup, place: int) -> float | None:
    """How far one coordinate may be from zero at the goal, at rest; None: as far as it likes."""
    task, count = setup.task, len(setup.plant.coordinates)
    at_goal: Any = getattr(task, "at_goal", None)
    if at_goal is None:
        return None

    def there(distance: float) -> bool:
        q = tuple(distance if k == place else 0.0 for k in range(count))
        return bool(at_goal(SCALAR, q, (0.0,) * count))

    inside, outside = 0.0, _FARTHEST_TRACES.get(setup.plant.coordinate_units[place], 10.0)
    if not there(inside) or there(outside):
        return None
    while outside - inside > 1e-9:
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if there(middle) else (inside, middle)
    return round(inside, 6)


MOST_SAMPLES: Final = 480
"""Of a trace; of a longer one every n-th is taken."""

_FIELDS: Final = (
    "record_id", "policy_id", "cell", "episode_index", "success", "failure_label",
    "time_to_success", '"return"', "energy_start", "energy_end", "length",
    "work_total", "energy_residual_total", "dissipated_total", "contact_loss_total",
    "clip_loss_total", "initial_state", *SENTENCE_COLUMNS,
)  # fmt: skip
_SUMS: Final = ("work", "energy_residual", "dissipated", "contact_loss", "clip_loss")

Key = tuple[str, str, int, int]
"""Row, cell, place of the seed, and episode."""


@dataclass(frozen=True)
class Trace:
    """An episode to watch.

    Attributes:
        key: which one.
        fields: its record's fields by name.
        period: time between two samples, s.
        motion: coordinates by name, shape (samples,).
        control: in force from each sample on, by name, shape (samples,).
        ledger: work of the motor, of the numerics, and losses since the start, J, shape
            (3, samples).
    """

    key: Key
    fields: Mapping[str, Any]
    period: float
    motion: Mapping[str, Array]
    control: Mapping[str, Array]
    ledger: Array


def traces_of(panel: Panel, store: EvidenceStore, leads: Iterable[Lead]) -> list[Trace]:
    """The traces that the leads ask for, in their order; without those that were not kept."""
    keys: dict[Key, None] = {}
    for lead in leads:
        keys.update(dict.fromkeys((lead.row, c, lead.seed, lead.episode) for c in lead.cells))
    if not keys:
        return []
    policies = {(r, s): panel.row(r).policies[s].id for r, _, s, _ in keys}
    wanted = {(policies[r, s], c, e): (r, c, s, e) for r, c, s, e in keys}
    states, controls = _columns(store)
    columns = ", ".join(
        (*_FIELDS, *(_named(name) for name in ("time", *states, *controls, *_SUMS)))
    )
    where = " AND ".join(
        f"{name} IN ({', '.join(sorted({_literal(key[place]) for key in wanted}))})"
        for place, name in enumerate(("policy_id", "cell", "episode_index"))
    )
    table = store.query(f"SELECT {columns} FROM records WHERE phase = 'evaluation' AND {where}")
    found = {}
    for record in table.to_pylist():
        key = wanted.get((record["policy_id"], record["cell"], record["episode_index"]))
        if key is not None and record["time"] and record["length"]:
            found[key] = _trace(key, record, states, controls)
    return [found[key] for key in keys if key in found]


def _columns(store: EvidenceStore) -> tuple[list[str], list[str]]:
    """Names of the coordinates and of the applied controls, from the order of the columns."""
    names = [
        str(name) for name in store.query("DESCRIBE records").column("column_name").to_pylist()
    ]
    after = names[names.index("time") + 1 :]
    states = list(itertools.takewhile(lambda name: not name.startswith("sensed_"), after))
    coordinates = [name for name in states if not name.endswith("_dot")]
    return coordinates[:4], [name for name in after if name.endswith("_applied")][:2]


def _trace(key: Key, record: Mapping[str, Any], states: list[str], controls: list[str]) -> Trace:
    length = record["length"]
    sums = {name: _cumulative(record[name], length) for name in _SUMS}
    losses = sums["dissipated"] + sums["contact_loss"] + sums["clip_loss"]
    ledger = np.stack((sums["work"], sums["energy_residual"], losses))
    motion = {name: _numbers(record[name], length + 1) for name in states}
    control = {name: _held(record[name], length) for name in controls}
    every = -(-(length + 1) // MOST_SAMPLES)
    kept = np.arange(0, length + 1, every)
    return Trace(
        key,
        {name: record[name] for name in map(_bare, _FIELDS)},
        record["control_period"] * every,
        {name: values[kept] for name, values in motion.items()},
        {name: values[kept] for name, values in control.items()},
        ledger[:, kept],
    )


def _numbers(values: Any, count: int) -> Array:
    """Finite numbers, the last one known where there is none."""
    found = np.array([np.nan if x is None else x for x in (values or ())][:count], float)
    found = np.concatenate((found, np.full(count - len(found), np.nan)))
    known = np.where(np.isfinite(found), np.arange(count), 0)
    numbers: Array = np.nan_to_num(found[np.maximum.accumulate(known)], posinf=0.0, neginf=0.0)
    return numbers


def _held(values: Any, length: int) -> Array:
    numbers = _numbers(values, length)
    return np.append(numbers, numbers[-1:])


def _cumulative(values: Any, length: int) -> Array:
    steps = np.zeros(length) if values is None else np.nan_to_num(
        np.array([0.0 if x is None else x for x in values][:length], float),
        posinf=0.0, neginf=0.0,
    )  # fmt: skip
    return np.concatenate(([0.0], np.cumsum(steps)))


def _named(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _bare(name: str) -> str:
    return name.strip('"')


def _literal(value: Any) -> str:
    return str(value) if isinstance(value, int) else "'" + str(value).replace("'", "''") + "'"


@dataclass(frozen=True)
class Told:
    """Single episodes.

    Attributes:
        outcomes: of every episode, by row and cell.
        leads: what is worth watching, the most informative first.
        traces: of the leads.
        live: what can be simulated anew; None where nothing can.
    """

    outcomes: Mapping[tuple[str, str], Outcomes]
    leads: tuple[Lead, ...]
    traces: tuple[Trace, ...]
    live: Live | None = None


def told_by(panel: Panel, directory: str | PathLike[str]) -> Told | None:
    """What the evidence in a panel's directory tells; None where none is beside the panel.

    Raises:
        EvidenceError: for evidence that cannot be read.
    """
    store = EvidenceStore(Path(directory) / "evidence")
    if not store.files():
        return None
    outcomes = outcomes_of(panel, store)
    leads = chosen(panel, outcomes)
    traces = traces_of(panel, store, leads)
    there = {trace.key for trace in traces}
    shown = [lead for lead in leads if (lead.row, lead.cell, lead.seed, lead.episode) in there]
    live = live_of(panel, shown, Path(directory))
    return Told(outcomes, tuple(shown), tuple(traces), live)
