"""Time of a control period through our environment, over the bare engine's, in one run.

The bare loop is what a user of the engine alone would write for the same bodies (bare.py):
set the control, step, read the state back. Ours has observation, reward, ends of episodes, the
energy ledger and the whole `info`. Both take turns at the same controls from the same start, resets
off the clock, and must arrive at the same state. Times are the processor's, and a ratio is the
median over rounds of turns, with its quartiles.

The ratio that is wanted is that of `gym.make(...).unwrapped`: what Gymnasium's own wrappers add
(column `gym.make`) they add to every environment, and `env_throughput.py` has both with them.
`steps only` is the engine's step without setting or reading anything: no loop can do without those.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
from bounds import print_judged
from measuring import results
from measuring.bare import LOOPS
from measuring.rates import Advance, turns

import integ_gym  # noqa: F401
from integ_gym.envs.engines.stepping import missing_modules
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.ops.ops import split_state
from integ_gym.envs.registries import ENGINES
from integ_gym.support.optional import missing_package

EXAMPLES = """\
examples:
  python benchmarks/engines.py
  python benchmarks/engines.py --only mujoco --seconds 1
  python benchmarks/engines.py --only mujoco drake --json engines.json
"""

STARTS = {"IntegPendulum-v0": (2.0, 0.5), "IntegCartPole-v0": (0.0, 0.0, 0.05, 0.0)}
"""Environment to the state, in Gymnasium's order, that every turn starts from."""

DT = 0.002
"""Timestep, s: MuJoCo's own default."""

COUNTS = (1, 20)
"""Engine steps per control."""

PLAIN, DAMPED, SAMPLED, LIMITED = "", "damped", "sampled", "limited"
VARIANTS: dict[str, dict[str, dict[str, float]]] = {
    PLAIN: {name: {} for name in STARTS},
    DAMPED: {
        "IntegPendulum-v0": {"damping": 0.1},
        "IntegCartPole-v0": {"damping": 0.01, "cart_damping": 0.1},
    },
    SAMPLED: {name: {"sensor_period": DT} for name in STARTS},
    LIMITED: {name: {"max_speed": 100.0} for name in STARTS},
}
"""With damping, which the ledger books at every engine step; with a sensor that samples at every
engine step; with a speed limit, which is never reached. In the last two each step is a call."""

VARIED = ("mujoco", "drake")
"""Engines that are measured in all of these."""

LOOPED = {"pinocchio": ("symplectic_euler",), "casadi": ("rk",)}
"""Integrators of which there is a bare loop, where that is not all."""

BARE, OURS, MADE, ONLY = "bare", "env.step", "gym.make", "steps only"
"""Contenders: the loop, the environment without and with wrappers, the engine's step alone."""

TURN = 100
"""Control periods."""

COMPARED = 10
"""Control periods after which both are at the same state."""

TOLERANCE = {64: 1e-9, 32: 1e-4}
"""Of that state, by the width of the engine's floats."""

PACKAGES = (
    "integ-gym", "gymnasium", "numpy", "mujoco", "drake", "pin", "dartpy", "pybullet", "sapien",
    "casadi",
)  # fmt: skip


def measured(
    engine: str, integrator: str, environment: str, variant: str, count: int, seconds: float
) -> dict[str, Any]:
    """Measure one row: times of a control period, and ratios with their quartiles.

    ``seconds`` are median times by contender; ``ratios`` those of `env.step` to another, the median
    in the middle; ``made_ratio`` is that of `gym.make` to the bare loop.

    Raises:
        RuntimeError: if the bare loop does not go where the environment goes.
    """
    chosen: dict[str, Any] = {
        "engine": engine, "integrator": integrator, "dt": DT, "control_period": count * DT,
        **VARIANTS[variant][environment],
    }  # fmt: skip
    bare = LOOPS[engine](environment_setup(environment, chosen))
    made, other = (gym.make(environment, **chosen) for _ in range(2))
    ours: Any = other.unwrapped

    def begin() -> None:
        for env in (made, ours):
            env.reset(options={"state": STARTS[environment]})
        bare.start(*split_state(STARTS[environment]))

    made.action_space.seed(0)
    actions = [made.action_space.sample() for _ in range(TURN)]
    begin()
    controls = [ours.step(action)[4]["control"] for action in actions]
    begin()
    _stepped(ours, actions[:COMPARED])()
    got = np.array(bare.drive(controls[:COMPARED])).T.ravel()
    if not np.allclose(got, ours.state, rtol=0.0, atol=TOLERANCE[ours.setup.engine.width]):
        raise RuntimeError(
            f"the bare loop of {engine} {integrator} is at {got.tolist()} where the environment is "
            f"at {ours.state}"
        )
    contenders: dict[str, Advance] = {
        BARE: lambda: (bare.drive(controls), TURN)[1],
        OURS: _stepped(ours, actions),
        MADE: _stepped(made, actions),
        ONLY: lambda: (bare.only_step(TURN), TURN)[1],
    }
    found = turns(contenders, seconds, begin, time.process_time)
    times = {name: 1.0 / np.array(rates) for name, rates in found.items()}
    return {
        "engine": engine,
        "integrator": integrator,
        "environment": environment,
        "variant": variant,
        "count": count,
        "seconds": {name: float(np.median(values)) for name, values in times.items()},
        "ratios": {name: _quartiles(times[OURS] / times[name]) for name in (BARE, ONLY)},
        "made_ratio": _quartiles(times[MADE] / times[BARE]),
    }


def _stepped(environment: Any, actions: Sequence[Any]) -> Advance:
    def advance() -> int:
        for action in actions:
            environment.step(action)
        return len(actions)

    return advance


def _quartiles(values: Any) -> tuple[float, ...]:
    return tuple(np.quantile(values, (0.25, 0.5, 0.75)).tolist())


def rows(engines: Sequence[str], seconds: float) -> Iterator[dict[str, Any]]:
    """All rows of some engines."""
    for engine in engines:
        for integrator in LOOPED.get(engine, ENGINES.load(engine).maps):
            variants = tuple(VARIANTS) if engine in VARIED else (PLAIN,)
            for case in product(STARTS, variants, COUNTS):
                print(engine, integrator, *case, file=sys.stderr)
                yield measured(engine, integrator, *case, seconds)


def cells(row: dict[str, Any]) -> list[str]:
    """A row of the printed table."""
    low, middle, high = row["ratios"][BARE]
    return [
        row["engine"], row["integrator"], row["environment"], row["variant"], str(row["count"]),
        *(f"{1e6 * row['seconds'][name]:.2f}" for name in (ONLY, BARE, OURS, MADE)),
        f"{middle:.2f}", f"{low:.2f}-{high:.2f}", f"{row['made_ratio'][1]:.2f}",
        f"{row['ratios'][ONLY][1]:.2f}",
    ]  # fmt: skip


HEADER = (
    "engine", "integrator", "environment", "", "steps", f"{ONLY}, us", f"{BARE}, us", f"{OURS}, us",
    f"{MADE}, us", f"{OURS} / {BARE}", "quartiles", f"{MADE} / {BARE}",
    f"{OURS} / {ONLY}",
)  # fmt: skip


def main() -> None:
    """Print the table; write JSON where asked."""
    parser = results.parser(__doc__, EXAMPLES, file=True)
    parser.add_argument("--only", nargs="+", choices=LOOPS, default=list(LOOPS), metavar="ENGINE")
    parser.add_argument("--seconds", type=float, default=0.3, help="time per contender, s")
    arguments = parser.parse_args()
    lacking = {name: modules for name in arguments.only if (modules := missing_modules(name))}
    for name, modules in lacking.items():
        print(f"{name} left out: {missing_package(', '.join(modules), name)}")
    found = list(rows([name for name in arguments.only if name not in lacking], arguments.seconds))
    results.print_table(HEADER, map(cells, found))
    content = {"rows": found}
    print_judged("engines", content)
    results.write(arguments.json, content, PACKAGES)


if __name__ == "__main__":
    main()
