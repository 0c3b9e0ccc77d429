"""Pictures of robots from the numbers of their skeleton, by a camera that follows from the side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .canvas import BLUE, FAINT, VERMILION, WHITE, Canvas, Point, tint

Array = npt.NDArray[np.float64]

SIZE = (600, 500)
"""Width and height of the picture, pixels."""

_ASIDE, _ABOVE = 0.42, 0.2
"""Angles by which the camera looks from ahead of the side, and down, rad."""
_TILE, _TILES = 0.5, 6
"""Of the floor: width of a tile, m, and how many to either side."""
_HORIZON = 0.82 * SIZE[1]
_TURN = np.linspace(0.0, 2.0 * np.pi, 14, endpoint=False)


class Shape(NamedTuple):
    """A line with round ends, or the hull of points.

    Attributes:
        body: that it is fixed to; -1: none.
        points: shape (n, 3), m.
        width: of the line, or of the hull's edge, m.
        closed: whether it is a hull.
    """

    body: int
    points: Array
    width: float
    closed: bool


class Skeleton:
    """A robot's bodies, joints and geoms.

    Args:
        described: see :func:`integ_gym.envs.testbeds.mjcf_model.describe_skeleton`.
        start: joint positions that the picture is to hold, shape (nq,).
    """

    def __init__(self, described: Mapping[str, Any], start: Array) -> None:
        self._bodies = [(p, np.array(at), _matrix(spin)) for p, at, spin in described["bodies"]]
        self._joints = described["joints"]
        self._feet = list(described["feet"].values())
        self._shapes = [_shape(*geom) for geom in described["geoms"] if geom[0] >= 0]
        self._root = self._joints[0][0] if self._joints else 0
        self._thick = 0.0
        points = np.concatenate([shape.points for shape in self._place(*self.pose(start))])
        floor = described["floor"]
        self._ground = float(points[:, 2].min()) if floor is None else floor
        high = float(points[:, 2].max()) - self._ground
        away = np.hypot(*(points - self.pose(start)[0][self._root])[:, :2].T).max()
        self._scale = min(0.7 * SIZE[1] / high, 0.4 * SIZE[0] / away)
        self._thick, self._high = min(0.05, 0.045 * high), high

    def pose(self, q: Array) -> tuple[Array, Array]:
        """Place and rotation matrix of every body, shapes (n, 3) and (n, 3, 3).

        Args:
            q: joint positions, shape (nq,).
        """
        places, turns = np.zeros((len(self._bodies), 3)), np.zeros((len(self._bodies), 3, 3))
        for body, (parent, at, spin) in enumerate(self._bodies):
            place, turn = at, spin
            if parent >= 0:
                place, turn = places[parent] + turns[parent] @ at, turns[parent] @ spin
            for _, kind, k, axis, anchor, reference in self._of(body):
                if kind == "free":
                    place, turn = q[k : k + 3], _matrix(q[k + 3 : k + 7])
                elif kind == "slide":
                    place = place + turn @ axis * (q[k] - reference)
                else:
                    fixed = place + turn @ anchor
                    half = 0.5 * (q[k] - reference)
                    about = (
                        q[k : k + 4]
                        if kind == "ball"
                        else [np.cos(half), *(np.sin(half) * np.array(axis))]
                    )
                    turn = turn @ _matrix(about)
                    place = fixed - turn @ anchor
            places[body], turns[body] = place, turn
        return places, turns

    def headings(self, q: Array, around: int) -> Array:
        """Where its free body heads, over some samples to either side, shape (n, 2).

        Args:
            q: joint positions, shape (n, nq).
            around: how many samples.
        """
        free = next((k for _, kind, k, *_ in self._joints if kind == "free"), None)
        if free is None:
            return np.tile([1.0, 0.0], (len(q), 1))
        ahead = np.array([_matrix(one[free + 3 : free + 7])[:2, 0] for one in q])
        sums: Array = np.array(
            [ahead[max(0, k - around) : k + around + 1].sum(0) for k in range(len(q))]
        )
        sums /= np.maximum(1e-9, np.hypot(*sums.T))[:, None]
        return sums

    def draw(self, canvas: Canvas, state: Sequence[float]) -> None:
        """Draw it on a white canvas.

        Args:
            canvas: of :data:`SIZE`.
            state: joint positions, heading, and the share of its weight that each foot carries.
        """
        split = len(state) - len(self._feet)
        q, (ahead, left) = np.array(state[: split - 2]), state[split - 2 : split]
        places, turns = self.pose(q)
        x = ahead * np.cos(_ASIDE) - left * np.sin(_ASIDE)
        y = left * np.cos(_ASIDE) + ahead * np.sin(_ASIDE)
        down, up = np.sin(_ABOVE), np.cos(_ABOVE)
        view = np.array([[x, y, 0.0], [-down * y, down * x, up], [-y, x, 0.0]])
        origin = np.array([*places[self._root][:2], self._ground])

        def see(points: Any) -> Array:
            """Place in the picture, pixels, and how far away, m, shape (n, 3)."""
            seen: Array = (np.asarray(points) - origin) @ view.T
            seen[:, 0] = SIZE[0] / 2 + self._scale * seen[:, 0]
            seen[:, 1] = _HORIZON - self._scale * seen[:, 1]
            return seen

        self._draw_floor(canvas, origin, see)
        shapes = self._place(places, turns)
        self._draw_shapes(canvas, [(one, see(one.points)) for one in shapes])
        for foot, share in zip(self._feet, state[split:], strict=True):
            points = [one.points for one in shapes if one.body == foot]
            if share > 0.02 and points:
                sole = min(np.concatenate(points).tolist(), key=lambda point: point[2])
                (a, b), tall = see([[*sole[:2], self._ground]])[0, :2], min(0.5 * share, 0.9)
                _draw_arrow(canvas, (a, b), b - tall * self._high * self._scale)

    def _draw_floor(self, canvas: Canvas, origin: Array, see: Any) -> None:
        middle, reach = _TILE * np.round(origin[:2] / _TILE), _TILE * _TILES
        for k in range(-_TILES, _TILES + 1):
            colour = tint(FAINT, 1.0 - abs(k) / (_TILES + 1))
            for ends in (
                [[k * _TILE, -reach], [k * _TILE, reach]],
                [[-reach, k * _TILE], [reach, k * _TILE]],
            ):
                (a, b, _), (c, d, _) = see([[*(middle + end), self._ground] for end in ends])
                canvas.line((a, b), (c, d), 1.5, colour, rounded=False)

    def _draw_shapes(self, canvas: Canvas, shapes: Sequence[tuple[Shape, Array]]) -> None:
        """The farthest first and palest."""
        far = [float(seen[:, 2].mean()) for _, seen in shapes]
        near, span = min(far), max(1e-9, max(far) - min(far))
        for place in np.argsort(far)[::-1]:
            shape, seen = shapes[place]
            points: list[Point] = [(x, y) for x, y, _ in seen.tolist()]
            outline = _hull(points) if shape.closed else points
            tone = tint(BLUE, 1.0 - 0.6 * (far[place] - near) / span)
            for colour, more in ((WHITE, 3.0), (tone, 0.0)):
                if shape.closed:
                    canvas.polygon(outline, colour)
                edges = zip(outline, outline[1:] + outline[:1], strict=True)
                width = shape.width * self._scale + more
                for start, end in edges if width else ():
                    canvas.line(start, end, width, colour)

    def _of(self, body: int) -> list[Any]:
        return [joint for joint in self._joints if joint[0] == body]

    def _place(self, places: Array, turns: Array) -> list[Shape]:
        """Bones and geoms in the world."""
        jointed = {joint[0] for joint in self._joints}
        bones = [
            Shape(-1, places[[parent, body]], self._thick, False)
            for body, (parent, *_) in enumerate(self._bodies)
            if parent >= 0 and body in jointed
        ]
        geoms = (
            one._replace(points=places[one.body] + one.points @ turns[one.body].T)
            for one in self._shapes
        )
        return [*bones, *geoms]


def _matrix(quaternion: Any) -> Array:
    w, x, y, z = np.asarray(quaternion) / np.linalg.norm(quaternion)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def _shape(body: int, kind: str, sizes: Sequence[float], at: Any, spin: Any) -> Shape:
    """A geom in its body's frame."""
    a, b, c = sizes
    cos, sin, zero = np.cos(_TURN), np.sin(_TURN), np.zeros(len(_TURN))
    line = kind in ("sphere", "capsule")
    points: Any
    if line:
        half = b if kind == "capsule" else 0.0
        points = [[0.0, 0.0, -half], [0.0, 0.0, half]]
    elif kind == "box":
        points = [[x, y, z] for x in (-a, a) for y in (-b, b) for z in (-c, c)]
    elif kind == "cylinder":
        points = [[a * x, a * y, z] for z in (-b, b) for x, y in zip(cos, sin, strict=True)]
    else:
        rings = ([a * cos, b * sin, zero], [a * cos, zero, c * sin], [zero, b * cos, c * sin])
        points = np.concatenate([np.stack(ring, axis=1) for ring in rings])
    placed = np.asarray(at) + np.asarray(points) @ _matrix(spin).T
    return Shape(body, placed, 2.0 * a if line else 0.0, not line)


def _hull(points: list[Point]) -> list[Point]:
    """The corners of the least convex polygon around points, in order."""

    def half(order: list[Point]) -> list[Point]:
        kept: list[Point] = []
        for x, y in order:
            while len(kept) > 1:
                (ax, ay), (bx, by) = kept[-2:]
                if (bx - ax) * (y - ay) > (by - ay) * (x - ax):
                    break
                kept.pop()
            kept.append((x, y))
        return kept[:-1]

    ordered = sorted(points)
    return [*half(ordered), *half(ordered[::-1])]


def _draw_arrow(canvas: Canvas, foot: Point, tip: float) -> None:
    x, y = foot
    for start in ((x, y), (x - 8.0, tip + 10.0), (x + 8.0, tip + 10.0)):
        canvas.line(start, (x, tip), 5.0, VERMILION)
