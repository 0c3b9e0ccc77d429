"""Time of one control period on the reference, counted in steps of RK4, in one run.

    python benchmarks/reference_cost.py

Both as straight-line scalar functions, as the single environment runs them. Where one inner step
of the reference suffices it costs what its 12 stages and its error estimate cost.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from integ_gym.envs.engines.native import NativeEngine
from integ_gym.envs.ops import Component, Components, Ops
from integ_gym.envs.plants import PLANTS
from integ_gym.envs.system import PlantSystem
from integ_gym.envs.tracing import SCALARS, compiled

CASES: tuple[tuple[str, Components, Components, float], ...] = (
    ("cart_pole", (0.0, 0.1), (0.1, 0.2), 0.02),
    ("pendulum", (2.0,), (1.0,), 0.02),
    ("pendulum", (2.0,), (1.0,), 0.05),
    ("pendulum", (2.0,), (8.0,), 0.05),
    ("elastic_pendulum", (0.1, 0.0), (0.2, 0.1), 0.02),
)
"""Plant, configuration, velocities and control period, s."""

CONTROL = 0.5
REPEATS, CALLS = 5, 300


def measure(plant: str, q: Components, v: Components, period: float) -> tuple[float, float, int]:
    """Seconds of an RK4 step and of the reference over a period, and its inner steps."""
    system = PlantSystem(PLANTS.load(plant)())
    rk4, reference = (_period(system, name, period) for name in ("rk4", "reference"))
    return _seconds(rk4, q, v), _seconds(reference, q, v), int(reference(q, v)[2])


def _period(system: PlantSystem, integrator: str, period: float) -> Callable[..., Any]:
    engine = NativeEngine(system, integrator, period)
    n = len(system.plant.coordinates)

    def advance(ops: Ops, q: Components, v: Components) -> tuple[Any, ...]:
        segments: tuple[tuple[Component, int], ...] = ((CONTROL, 1),)
        motion = engine.advance(ops, q, v, segments, None)
        return tuple(motion.q), tuple(motion.v), motion.iterations

    numbers = (False,) * n
    return compiled(SCALARS, advance, numbers, numbers)


def _seconds(function: Callable[..., Any], q: Components, v: Components) -> float:
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        for _ in range(CALLS):
            function(q, v)
        times.append((time.process_time() - start) / CALLS)
    return min(times)


def main() -> None:
    """Print the table."""
    print(
        f"{'plant':<18}{'period, s':>10}{'inner steps':>13}{'reference, us':>15}{'RK4 steps':>11}"
    )
    for plant, q, v, period in CASES:
        step, whole, inner = measure(plant, q, v, period)
        ratio = whole / step
        print(f"{plant:<18}{period:>10}{inner:>13}{1e6 * whole:>15.1f}{ratio:>8.1f}")


if __name__ == "__main__":
    main()
