"""Pictures of the plants: one drawing per plant, found by the plant's name."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..actuators import ServoPlant
from ..ops.ops import SCALAR, split_state
from ..plants.interface import state_names, state_units
from ..settings import Setup
from ..tasks.elastic_pendulum import NEAR_PLUMB
from ..tasks.interface import NEAR_UPRIGHT, wrap_angle
from ..tasks.quadrotor import NEAR_TARGET, ROOM
from ..tasks.reacher import MARKER_CENTRE, MARKER_RADIUS, NEAR_MARKER
from .canvas import BLUE, FAINT, GREEN, INK, MUTED, VERMILION, WHITE, Canvas, Point, polar, tint
from .skeletons import SIZE

_TRAIL = 0.1
"""How much of the past motion the trail behind a moving tip shows, s."""
_LONGEST_TRAIL = 2.0
"""Longest trail, rad."""
_CART = (54.0, 30.0)
"""Width and height of the cart, pixels."""
_COILS = 12


class Drawing(NamedTuple):
    """The picture of one plant."""

    size: tuple[int, int]
    """Width and height, pixels."""
    draw: Callable[[Canvas, Setup, Sequence[float], Sequence[float]], None]
    """Draws (canvas, setup, state, controls) on a white canvas."""


def find_drawing(plant: str) -> Drawing:
    """The drawing of a plant; for one that has none, its state in words."""
    return DRAWINGS.get(plant, Drawing((600, 400), draw_state_in_words))


def draw_pendulum(
    canvas: Canvas, setup: Setup, state: Sequence[float], controls: Sequence[float]
) -> None:
    """Rod or bob, the goal around upright, and an arc arrow that leaves the rod with the torque."""
    theta, theta_dot = state
    hinge, reach = (250.0, 250.0), 172.0
    near = abs(wrap_angle(SCALAR, theta)) < NEAR_UPRIGHT
    _goal(canvas, hinge, reach + 28.0, NEAR_UPRIGHT, near)
    canvas.arc(hinge, (reach + 27.0, reach + 29.0), (0.0, 2.0 * math.pi), FAINT)
    canvas.arc(hinge, (reach + 25.0, reach + 31.0), (-NEAR_UPRIGHT, NEAR_UPRIGHT), GREEN)
    _joint_stops(canvas, hinge, reach + 28.0, setup)
    _trail(canvas, hinge, reach, 16.0, theta, theta_dot)
    if isinstance(setup.plant, ServoPlant):
        _aim(canvas, hinge, polar(hinge, reach, controls[0]))
    else:
        _torque(canvas, hinge, theta, shares_of_limits(controls, setup)[0])
    _rod(canvas, hinge, polar(hinge, reach, theta), 24.0, setup.plant)
    canvas.disc(hinge, 8.0, WHITE)
    canvas.disc(hinge, 5.0, INK)


def draw_cart_pole(
    canvas: Canvas, setup: Setup, state: Sequence[float], controls: Sequence[float]
) -> None:
    """Track, cart and pole to scale, and an arrow that leaves the cart with the force."""
    x, _, theta, theta_dot = state
    arguments = setup.arguments()
    end = float(np.max(arguments.get("x_threshold", arguments["track_limit"])))
    goal = float(np.max(arguments.get("theta_threshold", NEAR_UPRIGHT)))
    scale = 230.0 / end
    hinge = (300.0 + scale * x, 238.0)
    _track(canvas, hinge[1] + 27.0, end)
    _track_stops(canvas, hinge[1], scale, setup)
    reach = pole_reach(setup.plant, scale)
    near = abs(wrap_angle(SCALAR, theta)) <= goal and abs(x) <= end
    _goal(canvas, hinge, reach + 16.0, goal, near)
    _trail(canvas, hinge, reach, 9.0, -theta, -theta_dot)
    _push(canvas, hinge, 300.0 + scale * controls[0], shares_of_limits(controls, setup)[0], setup)
    _cart(canvas, hinge)
    _rod(canvas, hinge, polar(hinge, reach, -theta), 12.0, setup.plant)
    canvas.disc(hinge, 4.0, WHITE)
    canvas.disc(hinge, 2.5, INK)


def draw_elastic_pendulum(
    canvas: Canvas, setup: Setup, state: Sequence[float], controls: Sequence[float]
) -> None:
    """Spring and bob to scale, the strip to come to rest in, and an arrow with the force."""
    x, _, y, _ = state
    scale = 210.0 / float(np.max(setup.plant.hanging_length))  # type: ignore[attr-defined]
    pivot = (300.0, 90.0)
    bob = (pivot[0] + scale * x, pivot[1] + 210.0 - scale * y)
    strength = 0.3 if abs(x) < NEAR_PLUMB else 0.12
    canvas.box((300.0, 225.0), (2.0 * NEAR_PLUMB * scale, 270.0), 1.0, tint(GREEN, strength))
    canvas.line((240.0, pivot[1]), (360.0, pivot[1]), 4.0, MUTED)
    _spring(canvas, pivot, bob)
    _push(canvas, bob, pivot[0] + scale * controls[0], shares_of_limits(controls, setup)[0], setup)
    canvas.disc(bob, 18.0, BLUE)


def draw_quadrotor(
    canvas: Canvas, setup: Setup, state: Sequence[float], controls: Sequence[float]
) -> None:
    """Room and target to scale, the body larger than that, and arrows with commanded thrusts."""
    x, z, theta = state[0], state[2], state[4]
    scale, target = 62.0, (0.0, 0.0)
    if hasattr(setup.task, "target"):
        target = setup.task.target(SCALAR, split_state(tuple(state))[0])
    aim = 300.0 + scale * target[0], 200.0 - scale * target[1]
    middle = (300.0 + scale * x, 200.0 - scale * z)
    canvas.box((300.0, 200.0), (2.0 * ROOM * scale, 2.0 * ROOM * scale), 4.0, FAINT)
    canvas.box((300.0, 200.0), (2.0 * ROOM * scale - 4.0, 2.0 * ROOM * scale - 4.0), 4.0, WHITE)
    near = math.dist((x, z), target) < NEAR_TARGET and abs(wrap_angle(SCALAR, theta)) < NEAR_UPRIGHT
    canvas.disc(aim, 3.0 * NEAR_TARGET * scale, tint(GREEN, 0.3 if near else 0.12))
    canvas.disc(aim, NEAR_TARGET * scale, tint(GREEN, 0.6))
    for side, share in zip((-1.0, 1.0), shares_of_limits(controls, setup), strict=True):
        rotor = polar(middle, side * 40.0, -theta - math.pi / 2)
        canvas.line(middle, rotor, 7.0, INK)
        _thrust(canvas, polar(rotor, 9.0, -theta), -theta, 62.0 * share)
        hub = polar(rotor, 7.0, -theta)
        ends = (polar(hub, end, -theta - math.pi / 2) for end in (-19.0, 19.0))
        canvas.line(next(ends), next(ends), 4.0, BLUE)
    canvas.disc(middle, 9.0, BLUE)


def draw_hopper(
    canvas: Canvas, setup: Setup, state: Sequence[float], controls: Sequence[float]
) -> None:
    """Torso, leg and ground to scale, which passes by, and an arrow with each control."""
    x, z, theta, hip, leg = state[::2]
    ground, scale = 320.0, 260.0
    joint = (300.0, ground - scale * z)
    swung = math.pi + hip - theta
    foot = polar(joint, scale * leg, swung)
    canvas.line((0.0, ground + 6.0), (600.0, ground + 6.0), 8.0, FAINT)
    finish = 300.0 + scale * (float(np.max(getattr(setup.task, "finish", math.inf))) - x)
    if finish < 600.0:
        canvas.line((max(0.0, finish), ground + 6.0), (600.0, ground + 6.0), 8.0, tint(GREEN, 0.3))
    for metre in range(math.ceil(x - 1.1), math.floor(x + 1.1) + 1):
        place = 300.0 + scale * (metre - x)
        canvas.line((place, ground + 4.0), (place, ground + 14.0), 2.0, MUTED)
        canvas.text(f"{metre} m".replace("-", "−"), (place, ground + 28.0), 17, MUTED, align=0.5)
    torque, force = shares_of_limits(controls, setup)
    _thrust(canvas, foot, swung if force >= 0.0 else swung - math.pi, 62.0 * abs(force))
    _spring(canvas, joint, foot)
    canvas.disc(foot, 8.0, INK)
    canvas.line(polar(joint, -18.0, -theta), polar(joint, 60.0, -theta), 44.0, BLUE)
    _torque(canvas, joint, swung, torque)
    canvas.disc(joint, 7.0, WHITE)
    canvas.disc(joint, 4.0, INK)


def draw_double_pendulum(
    canvas: Canvas, setup: Setup, state: Sequence[float], controls: Sequence[float]
) -> None:
    """Both links to scale, what the tip is to pass or to follow, and each torque or target."""
    upper, lower = math.pi + state[0], math.pi + state[0] + state[2]
    lengths = [float(np.max(getattr(setup.plant, name))) for name in ("length_1", "length_2")]
    hinge, scale = (250.0, 250.0), 200.0 / sum(lengths)
    elbow = polar(hinge, scale * lengths[0], upper)
    if getattr(setup.task, "ends_at_goal", False):
        height = hinge[1] - scale * lengths[0]
        canvas.line((20.0, height), (480.0, height), 2.0, GREEN)
    if hasattr(setup.task, "target"):
        _marker(canvas, hinge, scale, setup.task, state)
    shares = shares_of_limits(controls, setup)
    joints = ((hinge, upper, math.pi), (elbow, lower, upper))
    for place, control, share in zip(setup.plant.actuated, controls, shares, strict=True):
        joint, angle, zero = joints[place]
        if isinstance(setup.plant, ServoPlant):
            _aim(canvas, joint, polar(joint, scale * lengths[place], zero + control))
        else:
            _torque(canvas, joint, angle, share)
    canvas.line(hinge, elbow, 18.0, MUTED)
    canvas.line(elbow, polar(elbow, scale * lengths[1], lower), 18.0, BLUE)
    for joint in (hinge, elbow):
        canvas.disc(joint, 7.0, WHITE)
        canvas.disc(joint, 4.0, INK)


def draw_state_in_words(
    canvas: Canvas, setup: Setup, state: Sequence[float], controls: Sequence[float]
) -> None:
    """The state in words, for a plant without a picture of its own."""
    names, units = state_names(setup.plant), state_units(setup.plant)
    canvas.text(setup.plant.name, (300.0, 70.0), 32, INK, align=0.5)
    step = min(34.0, 230.0 / len(names))
    for row, (name, value, unit) in enumerate(zip(names, state, units, strict=True)):
        y = 125.0 + row * step
        canvas.text(name, (280.0, y), 0.7 * step, MUTED, align=1.0)
        canvas.text(f"{format_signed(value, 4)} {unit}", (310.0, y), 0.7 * step, INK)


def draw_robot(canvas: Canvas, setup: Any, state: Sequence[float], _: Sequence[float]) -> None:
    """A robot's skeleton; see :class:`.skeletons.Skeleton`."""
    setup.skeleton.draw(canvas, state)


ROBOT = "robot's skeleton"
"""Name of the plant that stands for any robot."""

DRAWINGS: dict[str, Drawing] = {
    ROBOT: Drawing(SIZE, draw_robot),
    "acrobot": Drawing((500, 500), draw_double_pendulum),
    "reacher": Drawing((500, 500), draw_double_pendulum),
    "pendulum": Drawing((500, 500), draw_pendulum),
    "cart_pole": Drawing((600, 400), draw_cart_pole),
    "elastic_pendulum": Drawing((600, 400), draw_elastic_pendulum),
    "hopper": Drawing((600, 400), draw_hopper),
    "quadrotor": Drawing((600, 400), draw_quadrotor),
    "guided_quadrotor": Drawing((600, 400), draw_quadrotor),
}
"""Plant name to drawing."""


def shares_of_limits(controls: Sequence[float], setup: Setup) -> list[float]:
    """Each control divided by its largest magnitude, in [-1, 1]."""
    pairs = zip(controls, setup.largest_controls, strict=True)
    return [max(-1.0, min(1.0, float(control) / most)) for control, most in pairs]


def format_signed(value: float, digits: int) -> str:
    """A number with its sign, unless it is zero as written."""
    text = f"{value:+.{digits}f}" if abs(value) < 1e6 else f"{value:+.{digits}e}"
    return text.replace("-", "−") if float(text) else f"{0:.{digits}f}"


def pole_reach(plant: Any, scale: float) -> float:
    """Length of the pole on the picture, pixels; to scale as far as there is room for it."""
    far = 1.0 if plant.mass_distribution == "point" else 2.0
    return min(150.0, max(30.0, far * float(np.max(plant.length)) * scale))


def _goal(canvas: Canvas, centre: Point, reach: float, half_angle: float, near: bool) -> None:
    colour = tint(GREEN, 0.3 if near else 0.12)
    canvas.arc(centre, (0.0, reach), (-half_angle, half_angle), colour)


def _trail(
    canvas: Canvas, centre: Point, reach: float, width: float, angle: float, speed: float
) -> None:
    """Where the tip has just been: the longer, the faster."""
    swept = max(-_LONGEST_TRAIL, min(_LONGEST_TRAIL, speed * _TRAIL))
    ring = (reach - width / 2, reach + width / 2)
    canvas.arc(centre, ring, (angle - swept, angle), tint(BLUE, 0.22), taper=True)


def _torque(canvas: Canvas, hinge: Point, theta: float, share: float) -> None:
    """An arc arrow; the grey arc is how far it gets at the torque limit."""
    if not share:
        return
    side, full = math.copysign(1.0, share), math.radians(130.0)
    start = theta + side * math.asin(15.0 / 80.0)
    canvas.arc(hinge, (78.5, 81.5), (start, start + side * full), FAINT)
    canvas.arc_arrow(hinge, 80.0, (start, start + share * full), 10.0, VERMILION)


def _aim(canvas: Canvas, root: Point, end: Point) -> None:
    """Where a servo is to bring a link."""
    canvas.line(root, end, 3.0, VERMILION)
    canvas.disc(end, 5.0, VERMILION)


def _marker(canvas: Canvas, hinge: Point, scale: float, task: Any, state: Sequence[float]) -> None:
    """The marker to follow, as large as the goal around it, and its way."""
    centre = hinge[0] + scale * MARKER_CENTRE[0], hinge[1] - scale * MARKER_CENTRE[1]
    ring = scale * MARKER_RADIUS
    canvas.arc(centre, (ring - 1.0, ring + 1.0), (0.0, 2.0 * math.pi), FAINT)
    q, v = split_state(tuple(state))
    x, z = task.target(SCALAR, q)
    strength = 0.6 if task.at_goal(SCALAR, q, v) else 0.3
    place = hinge[0] + scale * x, hinge[1] - scale * z
    canvas.disc(place, scale * NEAR_MARKER, tint(GREEN, strength))


def _push(canvas: Canvas, root: Point, target: float, share: float, setup: Setup) -> None:
    """A force along x, or where on x the target of a servo is."""
    if isinstance(setup.plant, ServoPlant):
        _aim(canvas, (target, root[1] + 30.0), (target, root[1] - 30.0))
    else:
        _force(canvas, root, share)


def _force(canvas: Canvas, hinge: Point, share: float) -> None:
    if share:
        x = hinge[0] + math.copysign(29.0, share)
        canvas.arrow((x, hinge[1]), x + 44.0 * share, 9.0, VERMILION)


def _thrust(canvas: Canvas, root: Point, angle: float, length: float) -> None:
    """An arrow of a length in pixels; angle from upright, rad, positive to the left."""
    head = min(14.0, length)
    neck, tip = polar(root, length - head, angle), polar(root, length, angle)
    canvas.line(root, neck, 4.0, VERMILION, rounded=False)
    sides = [polar(neck, side * 0.5 * head, angle - math.pi / 2) for side in (-1.0, 1.0)]
    canvas.polygon([tip, *sides], VERMILION)


def _rod(canvas: Canvas, hinge: Point, tip: Point, width: float, plant: Any) -> None:
    """A uniform rod, or a thin one with its mass at the tip."""
    if plant.mass_distribution == "point":
        canvas.line(hinge, tip, width / 3, MUTED)
        canvas.disc(tip, 0.9 * width, BLUE)
    else:
        canvas.line(hinge, tip, width, BLUE)


def _cart(canvas: Canvas, hinge: Point) -> None:
    x, y = hinge
    for side in (-1.0, 1.0):
        canvas.disc((x + side * 15.0, y + 18.0), 8.0, INK)
        canvas.disc((x + side * 15.0, y + 18.0), 3.0, WHITE)
    canvas.box((x, y), _CART, 5.0, INK)


def _spring(canvas: Canvas, pivot: Point, bob: Point) -> None:
    """A zigzag between two points."""
    along = bob[0] - pivot[0], bob[1] - pivot[1]
    length = max(1.0, math.hypot(*along))
    across = -along[1] / length, along[0] / length
    corner = pivot
    for coil in range(1, _COILS + 1):
        share, swing = coil / _COILS, 0.0 if coil == _COILS else 9.0 * (-1.0) ** coil
        following = (
            pivot[0] + share * along[0] + swing * across[0],
            pivot[1] + share * along[1] + swing * across[1],
        )
        canvas.line(corner, following, 2.5, MUTED)
        corner = following


def _joint_stops(canvas: Canvas, hinge: Point, radius: float, setup: Setup) -> None:
    """A bar across the ring at either stop."""
    if setup.system.stops is not None:
        limit = float(np.max(setup.system.stops.limit))
        for angle in (-limit, limit):
            ends = (polar(hinge, radius - 9.0, angle), polar(hinge, radius + 9.0, angle))
            canvas.line(*ends, 6.0, INK)


def _track_stops(canvas: Canvas, y: float, scale: float, setup: Setup) -> None:
    """A post where the side of the cart touches either stop."""
    if setup.system.stops is not None:
        away = scale * float(np.max(setup.system.stops.limit)) + _CART[0] / 2 + 3.0
        for x in (300.0 - away, 300.0 + away):
            canvas.line((x, y - 15.0), (x, y + 27.0), 6.0, INK)


def _track(canvas: Canvas, y: float, end: float) -> None:
    canvas.line((0.0, y), (600.0, y), 2.0, FAINT)
    canvas.line((70.0, y), (530.0, y), 2.0, MUTED)
    for x, label in ((70.0, -end), (300.0, 0.0), (530.0, end)):
        canvas.line((x, y), (x, y + 9.0), 2.0, MUTED)
        canvas.text(f"{label:g} m".replace("-", "−"), (x, y + 21.0), 17, MUTED, align=0.5)
