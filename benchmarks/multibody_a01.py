"""Largest step with which every integrator and engine passes the multibody benchmark A01.

    python benchmarks/multibody_a01.py [--only rk4 mujoco ...] [--seconds 60] [--json FILE]

A point mass of 1 kg on a massless link of 1 m under 9.81 N/kg is released at rest from horizontal
and swings for 2000 s. The error, over 4000 outputs of x and y, may be 0.1 (low precision) or 0.001
(high precision). Problem and limits: M. González, D. Dopico, U. Lugrís and J. Cuadrado, "A
benchmarking system for MBS simulation software: Problem standardization and performance
measurement", Multibody System Dynamics 16 (2006) 179-190. The reference solution here is the exact
one in Jacobi's elliptic functions.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from measuring import results
from scipy.special import ellipj, ellipk
from tqdm import tqdm

from integ_gym.envs.engines.stepping import Engine, integrators_of, missing_modules
from integ_gym.envs.numerics.stepping import engine_of
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import ENGINES, INTEGRATORS, PLANTS
from integ_gym.envs.settings import NATIVE

LENGTH, GRAVITY = 1.0, 9.81
DURATION, OUTPUTS = 2000.0, 4000
"""s, and outputs after the start."""

THRESHOLD = 1e-3
"""m: errors are relative to the coordinate, or to this where it is smaller."""

LIMITS = {"low": 1e-1, "high": 1e-3}
"""Largest error, by precision."""

FEWEST, MOST = 1, 4096
"""Steps between two outputs."""

RELEASED = ((0.5 * math.pi,), (0.0,))
"""Angle from vertical down, rad, and rate, rad/s."""

FARTHEST = 1e6
"""rad: what is farther is lost."""

AT_ONCE = 50
"""Outputs of a compiled program between two looks at the time."""

Array = npt.NDArray[np.float64]


def exact() -> Array:
    """Positions (x, y) at the outputs, m, shape (4000, 2)."""
    times = np.linspace(0.0, DURATION, OUTPUTS + 1)[1:]
    modulus = math.sin(math.pi / 4.0)
    rate = math.sqrt(GRAVITY / LENGTH)
    sn = ellipj(ellipk(modulus**2) - rate * times, modulus**2)[0]
    swing = 2.0 * np.arcsin(modulus * sn)
    return LENGTH * np.stack([np.sin(swing), -np.cos(swing)], axis=-1)


def error_of(name: str, steps: int, truth: Array, deadline: float) -> float:
    """Error of an integrator with so many steps between outputs; infinite where it is lost.

    Raises:
        TimeoutError: past the deadline, a time of `time.process_time`.
    """
    plant = PLANTS.load("pendulum")(mass_distribution="point", gravity=GRAVITY)
    engine = engine_of(name, PlantSystem(plant), DURATION / OUTPUTS / steps)
    parts = []
    for more in (_compiled if engine.name == NATIVE else _stepped)(engine, steps):
        parts.append(more)
        if not (np.abs(more) < FARTHEST).all():
            return math.inf
        if time.process_time() > deadline:
            raise TimeoutError
    angles = np.concatenate(parts)
    found = LENGTH * np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    relative = (found - truth) / np.maximum(np.abs(truth), THRESHOLD)
    return float(np.sqrt((relative**2).mean()))


def _stepped(engine: Engine, steps: int) -> Iterator[Array]:
    """Angles at the outputs, one at a time, from vertical down; not a number once it is lost."""
    q, v = RELEASED
    for _ in range(OUTPUTS):
        try:
            motion = engine.advance(SCALAR, q, v, (((0.0,), steps),), None)
        except ArithmeticError:
            yield np.array([math.nan])
            return
        q, v = motion.q, motion.v
        yield np.array([q[0] if motion.finite else math.nan], dtype=float)


def _compiled(engine: Engine, steps: int) -> Iterator[Array]:
    """The same by a compiled program in float64, many at a time."""
    import jax

    from integ_gym.envs.ops.jax_ops import JaxOps

    def output(state: Any, _: None) -> Any:
        motion = engine.advance(JaxOps("float64"), *state, (((0.0,), steps),), None)
        return (motion.q, motion.v), motion.q[0]

    run = jax.jit(lambda state: jax.lax.scan(output, state, length=AT_ONCE))
    state: Any = RELEASED
    for _ in range(OUTPUTS // AT_ONCE):
        with jax.enable_x64(True):
            state, angles = run(jax.tree.map(jax.numpy.asarray, state))
        yield np.asarray(angles)


def largest_steps(name: str, truth: Array, seconds: float) -> tuple[dict[str, float], str]:
    """Largest step by precision, s, on a ladder of ratio √2, and why it ended before the last."""
    found: dict[str, float] = {}
    deadline = time.process_time() + seconds
    ladder = dict.fromkeys(round(FEWEST * 2.0 ** (k / 2)) for k in range(2 * 12 + 1))
    for steps in ladder:
        try:
            error = error_of(name, steps, truth, deadline)
        except TimeoutError:
            finest = DURATION / OUTPUTS / steps
            return found, f"none down to {finest:.2g} s within {seconds:g} s of processor time"
        for precision, limit in LIMITS.items():
            if error <= limit:
                found.setdefault(precision, DURATION / OUTPUTS / steps)
        if len(found) == len(LIMITS):
            return found, ""
    return found, f"none down to {DURATION / OUTPUTS / MOST:.2g} s"


def subjects(only: list[str] | None) -> Iterator[str]:
    """Integrators, then those of every installed engine, as ``"engine/integrator"``."""
    for name in INTEGRATORS.names():
        if not only or name in only:
            yield name
    for engine in ENGINES.names():
        if engine == NATIVE or missing_modules(engine) or (only and engine not in only):
            continue
        for integrator in integrators_of(engine):
            yield f"{engine}/{integrator}"


def main() -> None:
    """Measure, print a table, and write JSON where asked."""
    parser = results.parser(__doc__, file=True)
    parser.add_argument("--only", nargs="+", help="integrators and engines; default: all")
    parser.add_argument(
        "--seconds",
        type=float,
        default=60.0,
        help="of processor time, for each integrator, compilation included",
    )
    given = parser.parse_args()
    truth, rows, found = exact(), [], {}
    for name in tqdm(list(subjects(given.only)), unit="integrator"):
        steps, remark = largest_steps(name, truth, given.seconds)
        found[name] = {"largest_step": steps, "remark": remark}
        rows.append((name, *(f"{steps[p]:.3g}" if p in steps else "-" for p in LIMITS), remark))
    names = [f"{name} precision ({limit:g}), s" for name, limit in LIMITS.items()]
    results.print_table(("integrator", *names, ""), rows)
    results.write(given.json, {"found": found}, ["integ-gym", "numpy", "mujoco", "drake", "pin"])


if __name__ == "__main__":
    main()
