"""What a step makes of contact: rebound and sliding distance of every integrator.

    python benchmarks/contact.py [--only rk4 …] [--json FILE]

A puck of 1 kg on a plane of 1e4 N/m, 0.5 s/m and μ = 0.5. Thrown against it at 1 m/s without
gravity, touching at 16 places within a step: the coefficient of restitution, least and most, beside
Hunt and Crossley's closed form. Sliding at 1 m/s under 10 m/s², with friction smoothed over
0.02 m/s: the distance beside the closed form. Then the coarsest step at which it lies still, by the
eigenvalues of one step at rest, and the coarsest, halved again and again, from which on rebound and
distance are right to 1 %.
"""

from __future__ import annotations

import sys
from math import asinh, ceil, hypot, inf, log1p
from pathlib import Path

import numpy as np
from measuring import results

from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.ops.ops import ARRAY
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import INTEGRATORS, TRUTH

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers" / "envs"))

from touching import Puck

RATE = 100.0
"""Of the puck on the plane, √(k/m), rad/s."""
STEPS = tuple(z / RATE for z in (1.0, 0.25, 0.0625))
"""The three of the table, s: at hω of 1, 1/4 and 1/16."""
PHASES = 16
LADDER = tuple(2.0**-k / RATE for k in range(-3, 10))
NEAR = 0.01
THROWN = Puck(gravity=0.0)
SLIDING = Puck(gravity=10.0, friction_speed=0.02)
DEPTH = SLIDING.gravity / RATE**2
"""That the puck's weight presses it in, m."""


def restitution(arrival: float = 1.0, d: float = THROWN.plane_damping) -> float:
    """Speed of departure, m/s, by g(arrival) = g(-departure)."""
    low, high = 0.0, arrival
    for _ in range(100):
        middle = 0.5 * (low + high)
        spent = -middle / d - log1p(-d * middle) / d**2
        above = spent < arrival / d - log1p(d * arrival) / d**2
        low, high = (middle, high) if above else (low, middle)
    return low


def distance(puck: Puck = SLIDING) -> float:
    """Over which a puck comes to rest from 1 m/s, m: ∫ √(v² + v_s²) dv / μg."""
    smooth, slowing = puck.friction_speed, puck.friction * puck.gravity
    return float(hypot(1.0, smooth) + smooth**2 * asinh(1.0 / smooth)) / (2.0 * slowing)


def rebounds(integrator: str, dt: float) -> np.ndarray:
    """The coefficient of restitution at every place within a step, shape (16,)."""
    away = dt * (0.5 + np.arange(PHASES)) / PHASES
    engine = NativeEngine(PlantSystem(THROWN), integrator, dt)
    steps = ceil(0.1 / dt) + 2
    still = np.zeros(PHASES)
    motion = engine.advance(ARRAY, (still, away), (still, still - 1.0), (((0.0,), steps),), None)
    return np.where(np.isfinite(motion.v[1]), motion.v[1], np.inf)


def slid(integrator: str, dt: float) -> float:
    """How far the puck has come after 1 s, m."""
    engine = NativeEngine(PlantSystem(SLIDING), integrator, dt)
    start = np.zeros(1), np.array([-DEPTH])
    with np.errstate(all="ignore"):
        motion = engine.advance(
            ARRAY, start, (np.ones(1), np.zeros(1)), (((0.0,), round(1.0 / dt)),), None
        )
    return float(motion.q[0][0])


def _growth(integrator: str, dt: float, coordinate: int) -> float:
    """Largest magnitude of an eigenvalue of one step at rest, along one coordinate."""
    engine, small = NativeEngine(PlantSystem(SLIDING), integrator, dt), 1e-7
    rest = np.array([[0.0], [-DEPTH], [0.0], [0.0]]) * np.ones(4)
    places = [coordinate, coordinate + 2]
    rest[places, [0, 1]] += small
    rest[places, [2, 3]] -= small
    motion = engine.advance(ARRAY, tuple(rest[:2]), tuple(rest[2:]), (((0.0,), 1),), None)
    ends = np.array([*motion.q, *motion.v])[places]
    return float(np.abs(np.linalg.eigvals((ends[:, :2] - ends[:, 2:]) / (2.0 * small))).max())


def stable_step(integrator: str, coordinate: int) -> float:
    """The coarsest step at which nothing grows, s; infinite where a step of 10 s is none."""
    low, high = 1e-6, 10.0
    if _growth(integrator, high, coordinate) <= 1.0 + 1e-6:
        return inf
    for _ in range(40):
        middle = (low * high) ** 0.5
        stable = _growth(integrator, middle, coordinate) <= 1.0 + 1e-6
        low, high = (middle, high) if stable else (low, middle)
    return low


def needed_step(integrator: str) -> float:
    """The coarsest of the ladder at which rebound and distance are right to 1 %, s; and so below.

    Below it two more are looked at. 0: none.
    """
    right: list[float] = []
    for dt in LADDER:
        near = bool(np.abs(rebounds(integrator, dt) - restitution()).max() < NEAR)
        near = near and abs(slid(integrator, dt) / distance() - 1.0) < NEAR
        right = [*right, dt] if near else []
        if len(right) == 3:
            break
    return right[0] if right else 0.0


def _told(dt: float) -> str:
    return "any" if dt == inf else f"{1e3 * dt:.3g}"


def main() -> None:
    """Measure, print and store."""
    parser = results.parser(__doc__, file=True)
    names = INTEGRATORS.names()
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="INTEGRATOR")
    given = parser.parse_args()
    exact, far = restitution(), distance()
    rows, measured = [], []
    for integrator in given.only:
        bounced = [rebounds(integrator, dt) for dt in STEPS]
        come = [slid(integrator, dt) for dt in STEPS]
        still = [stable_step(integrator, coordinate) for coordinate in (1, 0)]
        needed = inf if integrator == TRUTH else needed_step(integrator)
        ends = [(float(x.min()), float(x.max())) for x in bounced]
        row = {"restitution": ends, "distance": come, "still": still, "needed": needed}
        measured.append({"integrator": integrator, **row})
        spread = [f"{low:.3f} to {high:.3f}" for low, high in ends]
        off = [f"{1e3 * (x - far):+.2f}" for x in come]
        rows.append([integrator, *spread, *off, *map(_told, (*still, needed))])
    print(f"e = {exact:.4f}, x = {1e3 * far:.2f} mm")
    heads = [f"{what}, {1e3 * dt:g} ms" for what in ("e", "x - exact, mm") for dt in STEPS]
    limits = ("still: pressed, ms", "still: rubbed, ms", "right to 1 %, ms")
    results.print_table(("integrator", *heads, *limits), rows)
    results.write(given.json, {"exact": [exact, far], "rows": measured}, ("integ-gym", "numpy"))


if __name__ == "__main__":
    main()
