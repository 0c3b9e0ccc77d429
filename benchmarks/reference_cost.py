"""Time of one control period on the reference, counted in steps of RK4, in one run.

    python benchmarks/reference_cost.py [--json FILE]

Both as straight-line scalar functions, as the single environment runs them. Where one inner step
of the reference suffices it costs what its 12 stages and its error estimate cost.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

from bounds import print_judged
from measuring import results

from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.ops.compiling import compile_trace
from integ_gym.envs.ops.dialects import SCALARS
from integ_gym.envs.ops.ops import Components, Ops
from integ_gym.envs.plants.interface import controls_of
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import PLANTS

CASES: tuple[tuple[str, Components, Components, float], ...] = (
    ("acrobot", (1.0, 0.5), (2.0, -3.0), 0.2),
    ("cart_pole", (0.0, 0.1), (0.1, 0.2), 0.02),
    ("chain", (1.0, 0.5, -0.5), (2.0, -3.0, 1.0), 0.02),
    ("pendulum", (2.0,), (1.0,), 0.02),
    ("pendulum", (2.0,), (1.0,), 0.05),
    ("pendulum", (2.0,), (8.0,), 0.05),
    ("elastic_pendulum", (0.1, 0.0), (0.2, 0.1), 0.02),
    ("hopper", (0.0, 0.45, 0.05, -0.1, 0.43), (1.0, 0.0, 0.2, -2.0, 0.1), 0.02),
    ("quadrotor", (0.5, 0.5, 0.3, 0.0, 0.0), (0.5, -0.5, 1.0, 3.0, 3.2), 0.02),
    (
        "guided_quadrotor",
        (0.5, 0.5, 0.3, 0.0, 0.0, 0.5),
        (0.5, -0.5, 1.0, 3.0, 3.2, 0.4),
        0.02,
    ),
    ("reacher", (0.3, 1.2, 0.5), (1.0, -2.0, 2.0), 0.02),
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
        segments = ((controls_of(system.plant, CONTROL), 1),)
        motion = engine.advance(ops, q, v, segments, None)
        return tuple(motion.q), tuple(motion.v), motion.iterations

    numbers = (False,) * n
    return compile_trace(SCALARS, advance, numbers, numbers)


def _seconds(function: Callable[..., Any], q: Components, v: Components) -> float:
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        for _ in range(CALLS):
            function(q, v)
        times.append((time.process_time() - start) / CALLS)
    return min(times)


def rows() -> Iterator[dict[str, Any]]:
    """One per case."""
    for plant, q, v, period in CASES:
        step, whole, inner = measure(plant, q, v, period)
        yield {
            "plant": plant,
            "q": q,
            "v": v,
            "period": period,
            "inner_steps": inner,
            "seconds": whole,
            "rk4_steps": whole / step,
        }


def main() -> None:
    """Print the table; write JSON where asked."""
    parser = results.parser(__doc__, file=True)
    arguments = parser.parse_args()
    found = list(rows())
    cells = (
        (
            row["plant"], f"{row['period']:g}", str(row["inner_steps"]),
            f"{1e6 * row['seconds']:.1f}", f"{row['rk4_steps']:.1f}",
        )
        for row in found
    )  # fmt: skip
    results.print_table(("plant", "period, s", "inner steps", "reference, us", "RK4 steps"), cells)
    print_judged("reference_cost", {"rows": found})
    results.write(arguments.json, {"rows": found}, ("integ-gym", "numpy"))


if __name__ == "__main__":
    main()
