"""The ground of other engines beside ours: bounce, slip, depth and lost energy of two plants.

    python benchmarks/engine_contact.py
    python benchmarks/engine_contact.py --only native mujoco --markdown

Engines have contact laws of their own. They are other models than ours and than each other's, so
nothing here is called right: the same plant, of the same mass, lands on each, at the engine's
default parameters, with the same coefficient of friction and no restitution.

- *block*, 1 kg, μ = 0.5. Dropped from 50 mm: how high it comes after landing, how deep it sinks in,
  and the energy that is gone at the highest point. On the ground at 1 m/s: how far it slides. A
  rigid block that does not bounce has 0, 0, all of m g h, and v² / 2 μ g. Ours is a puck on a
  plane of 1e4 N/m and 0.5 s/m. The closed form of its rebound leaves out its weight during contact.
- *hopper*, without control, its foot 0.2 m above the ground and 0.3 m/s ahead: how high the hip
  comes after the first stance, how deep the foot sinks in, how far it slips, and the energy that is
  gone at the highest point. Its leg is the same in all; nothing has a closed form.

Three steps each, from coarse to fine.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from itertools import islice
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from contact import distance, restitution
from measuring import results
from measuring.boxes import BOXES, FRICTION, GRAVITY, MASS
from measuring.hoppers import GROUNDLESS, HOPPERS, State

from integ_gym.envs.engines.stepping import NativeEngine, missing_modules
from integ_gym.envs.ops.ops import SCALAR, Components
from integ_gym.envs.plants.hopper import Hopper
from integ_gym.envs.plants.interface import Plant
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.settings import NATIVE

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers" / "envs"))

from touching import Puck

STEPS = (0.002, 0.001, 0.0005)
"""s."""
DROP, SPEED = 0.05, 1.0
"""Of the block: height, m, and speed along the ground, m/s."""
BLOCK = Puck(mass=MASS, gravity=GRAVITY, friction=FRICTION)
FALL, SLIDE = 0.4, 0.4
"""Of the block: so long it is watched, s."""
HOPPER = (0.0, 0.7, 0.0, 0.0, 0.5), (0.3, 0.0, 0.0, 0.0, 0.0)
"""Start of the hopper, (q, v)."""
HOP, STANDS = 0.6, 0.4
"""Of the hopper: so long it is watched, s, and from where on its hip may be at the highest, s."""
NEAR = 0.001
"""A foot that is not higher than this slips, m."""
SUBJECTS: dict[str, tuple[str, ...]] = {
    NATIVE: ("reference", "rk4", "implicit_midpoint", "symplectic_euler"),
    "mujoco": ("Euler", "RK4"),
    "mjx": ("Euler", "RK4"),
    "mujoco_warp": ("Euler", "RK4"),
    "newton": ("featherstone",),
    "drake": ("tamsi", "sap"),
    "dart": ("semi_implicit_euler",),
    "pybullet": ("semi_implicit_euler",),
    "sapien": ("tgs", "pgs"),
}
MEASURES = {
    "block": ("bounces, mm", "sinks, mm", "loses, J", "slides, mm"),
    "hopper": ("hip up to, mm", "sinks, mm", "loses, J", "slips, mm"),
}


def closed_forms() -> dict[str, tuple[float, ...]]:
    """Of the block: of a rigid one, and of ours, of whose depth there is none."""
    weight, arrival = MASS * GRAVITY, sqrt(2.0 * GRAVITY * DROP)
    height = restitution(arrival, BLOCK.plane_damping) ** 2 / (2.0 * GRAVITY)
    return {
        "rigid": (0.0, 0.0, weight * DROP, 1e3 * SPEED**2 / (2.0 * FRICTION * GRAVITY)),
        "ours": (1e3 * height, np.nan, weight * (DROP - height), 1e3 * distance(BLOCK)),
    }


def native_states(plant: Plant, integrator: str, dt: float, start: State) -> Iterator[State]:
    """(q, v) after each step of ours, without a control."""
    engine, (q, v) = NativeEngine(PlantSystem(plant), integrator, dt), start
    none = (0.0,) * len(plant.controls)
    while True:
        motion = engine.advance(SCALAR, q, v, ((none, 1),), None)
        q, v = motion.q, motion.v
        yield q, v


def block(engine: str, integrator: str, dt: float) -> tuple[float, ...]:
    """What is measured of the block at a step; NaN where the engine has none."""

    def path(height: float, speed: float, span: float) -> Any:
        """Height, way and speeds up and along, (steps, 4)."""
        if engine == NATIVE:
            start = (0.0, height), (speed, 0.0)
            states = native_states(BLOCK, integrator, dt, start)
            rows = [(q[1], q[0], v[1], v[0]) for q, v in islice(states, round(span / dt))]
        else:
            rows = [*islice(BOXES[engine](integrator, dt, (height, speed)), round(span / dt))]
        return np.array(rows, dtype=np.float64)

    height, _, rising, _ = path(DROP, 0.0, FALL).T
    landed = int(sqrt(2.0 * DROP / GRAVITY) / dt) + 2
    top = landed + int(height[landed:].argmax())
    bounce = max(0.0, height[top])
    lost = MASS * (GRAVITY * (DROP - height[top]) - 0.5 * rising[top] ** 2)
    slid = path(0.0, SPEED, SLIDE)[-1, 1]
    return 1e3 * bounce, 1e3 * max(0.0, -height.min()), lost, 1e3 * slid


def hopper(engine: str, integrator: str, dt: float) -> tuple[float, ...]:
    """What is measured of the hopper at a step."""
    if engine == NATIVE:
        states = native_states(Hopper(), integrator, dt, HOPPER)
    else:
        states = HOPPERS[engine](integrator, dt, HOPPER)
    motion = list(islice(states, round(HOP / dt)))
    foot = np.array([_foot(q) for q, _ in motion])
    hip = np.array([q[1] for q, _ in motion])
    later = round(STANDS / dt)
    top = later + int(hip[later:].argmax())
    near = (foot[1:, 1] < NEAR) & (foot[:-1, 1] < NEAR)
    slip = np.abs(np.diff(foot[:, 0]))[near][:top].sum()
    lost = _energy(HOPPER) - _energy(motion[top])
    return 1e3 * hip[top], 1e3 * max(0.0, -foot[:, 1].min()), lost, 1e3 * slip


def _foot(q: Components) -> tuple[float, float]:
    """Way and height, m."""
    frame = GROUNDLESS.foot(SCALAR, q)
    return q[0] + q[4] * frame.tangent[4], frame.gap


def _energy(state: State) -> float:
    return float(GROUNDLESS.energy(SCALAR, *state))


PLANTS: dict[str, tuple[Callable[[str, str, float], tuple[float, ...]], Any]] = {
    "block": (block, BOXES),
    "hopper": (hopper, HOPPERS),
}


def row(name: str, found: Any) -> list[str]:
    """Of a table, from (steps, measures)."""
    return [name, *(" / ".join(map(_said, column)) for column in np.transpose(found))]


def main() -> None:
    """Measure and print, engine after engine."""
    parser = results.parser(__doc__, file=True)
    parser.add_argument("--only", nargs="+", choices=SUBJECTS, default=SUBJECTS, metavar="ENGINE")
    parser.add_argument("--markdown", action="store_true", help="print the tables as Markdown")
    given = parser.parse_args()
    measured: list[dict[str, Any]] = []
    for plant, (measure, made) in PLANTS.items():
        rows = []
        for engine in given.only:
            if engine != NATIVE and (engine not in made or missing_modules(engine)):
                continue
            for integrator in SUBJECTS[engine]:
                found = [measure(engine, integrator, dt) for dt in STEPS]
                measured.append({"plant": plant, "engine": engine, "integrator": integrator})
                measured[-1]["values"] = found
                rows.append(row(f"{engine}/{integrator}", found))
        if plant == "block":
            forms = closed_forms().items()
            rows += [row(f"closed form, {name}", [values]) for name, values in forms]
        heads = (f"{plant}, {' / '.join(f'{1e3 * dt:g}' for dt in STEPS)} ms", *MEASURES[plant])
        if given.markdown:
            print("\n".join(results.markdown(heads, rows)), end="\n\n")
        else:
            results.print_table(heads, rows)
    packages = (
        "integ-gym",
        "numpy",
        "jax",
        "mujoco",
        "mujoco-mjx",
        "mujoco-warp",
        "newton",
        "warp-lang",
        "drake",
        "dartpy",
        "pybullet",
        "sapien",
    )
    results.write(given.json, {"steps": STEPS, "rows": measured}, packages)


def _said(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.4g}" if value > 100.0 else f"{value:.3g}"


if __name__ == "__main__":
    main()
