"""The task of a panel in words and as a picture, from what plant and task say of themselves."""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass
from typing import Any, Final

import gymnasium as gym
import numpy as np

from integ_gym.envs.catalogue.lookup import environment_setup, is_integ_environment
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.settings import Setup
from integ_gym.envs.testbeds.making import testbed_of

from ...panel.model.panel import Panel

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
        goal = testbed_of(env_id, panel.spec.get("environment", {})).success.goal
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
