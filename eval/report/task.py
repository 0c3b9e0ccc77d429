"""The task of a panel in words and as a picture, from what plant and task say of themselves."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import gymnasium as gym
import numpy as np

from integ_gym.envs.actuators import ServoPlant
from integ_gym.envs.environment import environment_setup, is_integ_environment
from integ_gym.envs.ops.compiling import source_of
from integ_gym.envs.ops.dialects import JAVASCRIPT
from integ_gym.envs.ops.ops import (
    SCALAR,
    Component,
    Components,
    NotTraceable,
    Ops,
    split_state,
)
from integ_gym.envs.settings import Setup
from integ_gym.envs.testbeds.making import find_testbed

from ..panel.result import Panel

_FARTHEST: Final = {"rad": math.pi, "m": 10.0}
"""How far from zero the edge of the goal is sought, by a coordinate's unit."""


class Task(NamedTuple):
    """What a policy is asked to do.

    Attributes:
        lead: the task in a sentence.
        facts: (name, words) of goal, motor, decisions and episode.
        scene: links, goal and limits to draw, fit for JSON; None where the plant does not tell
            its shape.
    """

    lead: str
    facts: list[tuple[str, str]]
    scene: dict[str, Any] | None


def describe_task(panel: Panel) -> Task | None:
    """The task of a panel; None of one that only code of a user's own can tell of."""
    env_id, given = str(panel.spec.get("env_id")), panel.spec.get("environment", {})
    periods = [cell.control_period for cell in panel.columns]
    decisions = "one every {:g} s, held in between"
    setup = panel_setup(panel)
    if setup is not None:
        plant, duration = setup.plant, f"{setup.settings.duration:g} s"
        goal = setup.task.goal.replace("theta", "θ").replace("`duration`", duration)
        motor = describe_motors(setup)
        gravity = getattr(plant, "gravity_torque", None)
        if gravity is not None:
            motor += f"; gravity pulls with up to {float(np.max(gravity)):g} {plant.controls[0][1]}"
        facts = [
            ("goal", goal),
            ("servos" if isinstance(plant, ServoPlant) else "motor", motor),
            ("decisions", decisions.format(setup.timing.control_period)),
            ("episode", f"{duration}, start: {setup.settings.start}"),
        ]
        lead = (inspect.getdoc(type(setup.task)) or setup.task.goal).splitlines()[0]
        return Task(lead, facts, _scene(setup))
    if env_id not in gym.registry:
        return None
    try:
        facts = [("goal", find_testbed(env_id, given).success.goal)]
    except ModuleNotFoundError:  # the simulator of one of Gymnasium's own
        return None
    if periods and not panel.mixed_periods:
        facts.append(("decisions", decisions.format(periods[0])))
    return Task(f"{env_id} of Gymnasium.", facts, None)


def panel_setup(panel: Panel) -> Setup | None:
    """Plant and task of a panel; None of a task that is not integ-gym's own in kind."""
    env_id, given = str(panel.spec.get("env_id")), panel.spec.get("environment", {})
    if not is_integ_environment(env_id):
        return None
    periods = [cell.control_period for cell in panel.columns]
    same = {"dt": periods[0], "control_period": periods[0]} if periods else {}
    return environment_setup(env_id, {**given, **same, "solver": None})


def describe_motors(setup: Setup) -> str:
    """The controls with their limits, in words."""
    parts = []
    for (name, unit), (low, high) in zip(
        setup.plant.controls, setup.task.control_limits, strict=True
    ):
        low, high = float(np.min(low)), float(np.max(high))
        within = f"up to ±{high:g}" if low == -high else f"from {low:g} to {high:g}"
        parts.append(f"{name.replace('_', ' ')} {within} {unit}")
    if isinstance(setup.plant, ServoPlant):
        plant, efforts = setup.plant, setup.task.effort_limits  # type: ignore[attr-defined]
        most = max(float(np.max(np.abs(ends))) for ends in efforts)
        gains = f"{np.max(plant.servo_stiffness):g} and {np.max(plant.servo_damping):g}"
        parts.append(f"{plant.servo}, k_p and k_d {gains}, effort up to ±{most:g} (SI units)")
    return ", ".join(parts)


def _scene(setup: Setup) -> dict[str, Any] | None:
    """Links of a mechanism, a point below the pivot of its spring, or a body that flies or hops."""
    plant: Any = setup.plant
    task: Any = setup.task
    flies_or_hops = tuple(plant.coordinate_units[:3]) == ("m", "m", "rad")
    flies = flies_or_hops and hasattr(plant, "arm")
    mechanism = None if flies else getattr(plant, "mechanism", None)
    links = [
        {
            "joint": link.joint,
            "point": float(np.max(link.inertia)) == 0.0,
            # Below zero of one that hangs at zero. A uniform link is twice as long as its centre is
            # far.
            "length": float(np.max(link.length))
            or float(np.max(link.centre)) * (2.0 if np.max(link.inertia) else 1.0),
        }
        for link in (mechanism.links if mechanism else ())
    ]
    swings = tuple(plant.coordinate_units) == ("m", "m") and hasattr(plant, "hanging_length")
    hops = flies_or_hops and hasattr(plant, "leg_length")
    if not links and not swings and not flies and not hops:
        return None
    rest = (0.0,) * len(plant.coordinates)
    goal = [_half_goal(setup, place) for place in range(len(rest))]
    angles = [unit == "rad" for unit in plant.coordinate_units]
    pose = [2.2 if angle else 0.0 for angle in angles]
    if task.terminated(SCALAR, tuple(pose), rest):
        pose = [
            0.5 * (half or 0.2) if angle else 0.0 for half, angle in zip(goal, angles, strict=True)
        ]
    flyer = None
    if flies:
        room = _edge(lambda x: not task.terminated(SCALAR, (x, *rest[1:]), rest), _FARTHEST["m"])
        flyer = {"arm": float(np.max(plant.arm)), "room": room or 5.0}
        pose = [0.3 * (room or 0.0), 0.3 * (room or 0.0), -0.4, *pose[3:]]
    places = visible_places(plant)
    hopper = None
    if hops:
        hopper = {"leg": float(np.max(plant.leg_length)), "finish": getattr(task, "finish", None)}
        pose = list(typical_start(setup)[0])
    return {
        "coordinates": [plant.coordinates[k] for k in places],
        "units": [plant.coordinate_units[k] for k in places],
        "places": places,
        "links": links,
        "bob": {"pivot": float(np.max(plant.hanging_length))} if swings else None,
        "flyer": flyer,
        "hopper": hopper,
        "target": {"near": task.near_target} if target_script(setup) else None,
        "clockwise": "counter-clockwise" not in plant.frame,
        "goal": goal,
        "pose": [pose[k] for k in places],
        "controls": [list(control) for control in plant.controls],
        "targets": isinstance(plant, ServoPlant),
        "actuated": list(plant.actuated),
        "limits": list(setup.largest_controls),
        "upright": round(setup.energy_at_goal, 6),
    }


def visible_places(plant: Any) -> list[int]:
    """Places of the coordinates that can be seen: lengths and angles."""
    return [k for k, unit in enumerate(plant.coordinate_units) if unit in ("m", "rad")]


def typical_start(setup: Setup) -> tuple[Components, Components]:
    """One of the starts of a setup, (q, v)."""
    rng = np.random.default_rng(0)
    return split_state(setup.task.draw_start(rng, setup.settings.start, {}))


def target_script(setup: Setup) -> str | None:
    """The place of what moves by itself, (x, z) of the coordinates that are seen, in JavaScript.

    Returns:
        None of a task without, and where it cannot be written down.
    """
    target: Any = getattr(setup.task, "target", None)
    if target is None:
        return None
    places = visible_places(setup.plant)

    def place(ops: Ops, seen: Components) -> Components:
        q: list[Component] = [0.0] * len(setup.plant.coordinates)
        for k, value in zip(places, seen, strict=True):
            q[k] = value
        return tuple(target(ops, tuple(q)))

    try:
        return source_of(JAVASCRIPT, place, (False,) * len(places))
    except NotTraceable:
        return None


def _half_goal(setup: Setup, place: int) -> float | None:
    """How far one coordinate may be from zero at the goal, at rest; None: as far as it likes."""
    at_goal: Any = getattr(setup.task, "at_goal", None)
    rest = (0.0,) * len(setup.plant.coordinates)

    def is_there(distance: float) -> bool:
        return bool(at_goal(SCALAR, (*rest[:place], distance, *rest[place + 1 :]), rest))

    farthest = _FARTHEST.get(setup.plant.coordinate_units[place], 10.0)
    return None if at_goal is None else _edge(is_there, farthest)


def _edge(is_inside: Callable[[float], bool], outside: float) -> float | None:
    """Up to which distance from zero something holds; None where not at zero, or far out still."""
    inside = 0.0
    if not is_inside(inside) or is_inside(outside):
        return None
    while outside - inside > 1e-9:
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if is_inside(middle) else (inside, middle)
    return round(inside, 6)
