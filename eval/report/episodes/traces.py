"""The task of a panel in words and as a picture, from what plant and task say of themselves."""

from __future__ import annotations

import inspect
import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import gymnasium as gym
import numpy as np

from integ_gym.envs.catalogue.lookup import environment_setup, is_integ_environment
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.settings import Setup
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.evidence.labels import SENTENCE_COLUMNS
from integ_gym.evidence.store import EvidenceStore

from ...panel.model.panel import Panel
from .choice import Array, Lead

_FARTHEST: Final = {"rad": math.pi, "m": 10.0}
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
    setup = _setup(panel)
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


def _setup(panel: Panel) -> Setup | None:
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

    inside, outside = 0.0, _FARTHEST.get(setup.plant.coordinate_units[place], 10.0)
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
