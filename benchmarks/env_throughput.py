"""Steps per second of single, vector and compiled environments beside their peers, in one run.

    python benchmarks/env_throughput.py [--only single vector scan] [--seconds 2.0] [--json FILE]

Peers: Gymnasium, and with `pip install --group bench` EnvPool and gymnax; without them their rows
say so. Random actions, drawn before the clock starts; resets, and in ours the whole `info`,
included. Environments of one task and number of lanes take turns, and a rate is that of a fast
turn. Ratios are to Gymnasium's environment of the same kind and number of lanes, to EnvPool's of
that number of lanes (of compiled ones: with 1024) with a thread per core, and to the fastest of
EnvPool's, which also runs with one thread; a second table has what is wanted of them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field

import gymnasium as gym
from bounds import print_judged
from measuring import results
from measuring.rates import envpool, rates, single, vector

import integ_gym  # noqa: F401
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.support.processes import cores

TASKS = {"Pendulum-v1": "IntegPendulum-v0", "CartPole-v1": "IntegCartPole-v0"}
LANES = (16, 64, 1024)
MANY = 1024
INTEGRATORS = ("explicit_euler", "symplectic_euler", "rk4", "implicit_midpoint", "reference")
COMPILED = ("explicit_euler", "symplectic_euler", "rk4", "implicit_midpoint")
SCANNED = COMPILED
SCAN_LANES, SCAN_STEPS = 4096, 2000
"""Per process."""

FASTEST = "fastest envpool"
PEERS = ("gymnasium", "envpool", FASTEST)

KINDS = ("single", "vector", "scan")
PACKAGES = ("integ-gym", "gymnasium", "numpy", "numba", "jax", "jaxlib", "envpool", "gymnax")


@dataclass
class Row:
    """The rate of one environment.

    Attributes:
        kind: single, vector or scan.
        package: whose environment it is.
        environment: its id.
        detail: integrator, or what else is special.
        lanes: environments advanced together; of a scan: per process.
        steps_per_second: of all processes; None where the package is not installed.
        steps_per_core_second: of a scan, per second of processor time.
        ratios: to the peers' environments of the same task.
    """

    kind: str
    package: str
    environment: str
    detail: str
    lanes: int
    steps_per_second: float | None
    steps_per_core_second: float | None = None
    ratios: dict[str, float] = field(default_factory=dict)


def single_rows(task: str, seconds: float) -> Iterator[Row]:
    """One environment, without and with evidence."""
    ours = TASKS[task]
    with tempfile.TemporaryDirectory() as store:
        context = EpisodeContext("benchmark", "single")
        recorded = RecordEvidence(gym.make(ours), store, context, commit_on_close=False)
        contenders = {
            ("gymnasium", task, ""): single(gym.make(task)),
            ("integ-gym", ours, ""): single(gym.make(ours)),
            ("integ-gym", ours, "with evidence"): single(recorded),
        }
        for (package, environment, detail), rate in rates(contenders, seconds).items():
            yield Row("single", package, environment, detail, 1, rate)


def vector_rows(task: str, seconds: float) -> Iterator[Row]:
    """Many environments as arrays."""
    ours = TASKS[task]
    for lanes in LANES:
        contenders = {}
        if lanes < MANY or gym.spec(task).vector_entry_point is not None:
            stock = gym.make_vec(task, num_envs=lanes)
            contenders["gymnasium", task, ""] = vector(stock, lanes)
        for threads in sorted({1, cores()}):
            pool = envpool(task, lanes, threads)
            if pool is None:
                yield Row("vector", "envpool", task, "", lanes, None)
                break
            contenders["envpool", task, "1 thread" if threads == 1 else f"{threads} threads"] = pool
        for integrator in INTEGRATORS:
            environment = gym.make_vec(ours, num_envs=lanes, integrator=integrator, compiled=False)
            contenders["integ-gym", ours, integrator] = vector(environment, lanes)
        for integrator in COMPILED:
            made = gym.make_vec(ours, num_envs=lanes, integrator=integrator, compiled=True)
            contenders["integ-gym", ours, f"{integrator}, compiled"] = vector(made, lanes)
        for (package, name, detail), rate in rates(contenders, seconds).items():
            yield Row("vector", package, name, detail, lanes, rate)


def scan_rows(tasks: list[str]) -> Iterator[Row]:
    """Compiled rollouts on all cores."""
    from measuring.scanned import scanned_rates

    cases = [case for t in tasks for case in ((t, None), *((TASKS[t], n) for n in SCANNED))]
    measured = scanned_rates(cases, SCAN_LANES, SCAN_STEPS)
    for (environment, integrator), found in zip(cases, measured, strict=True):
        package = "gymnax" if integrator is None else "integ-gym"
        detail = integrator or ""
        if found is None:
            yield Row("scan", package, environment, detail, SCAN_LANES, None)
        else:
            yield Row("scan", package, environment, detail, SCAN_LANES, **found)


def measure(kinds: list[str], seconds: float) -> Iterator[Row]:
    """All rows."""
    for task in TASKS:
        if "single" in kinds:
            yield from single_rows(task, seconds)
        if "vector" in kinds:
            yield from vector_rows(task, seconds)
        elif "scan" in kinds:
            pool = envpool(task, MANY, cores())
            rate = None if pool is None else rates({"envpool": pool}, seconds)["envpool"]
            yield Row("vector", "envpool", task, f"{cores()} threads", MANY, rate)
    if "scan" in kinds:
        yield from scan_rows(list(TASKS))


def compared(rows: list[Row]) -> list[Row]:
    """The rows with their ratios."""
    stock = {(r.kind, r.environment, r.lanes): r for r in rows if r.package == "gymnasium"}
    pools: dict[tuple[str, int], list[Row]] = {}
    for row in rows:
        if row.package == "envpool":
            pools.setdefault((row.environment, row.lanes), []).append(row)
    tasks = {ours: task for task, ours in TASKS.items()}
    for row in rows:
        task = tasks.get(row.environment, row.environment)
        peers = {"gymnasium": stock.get((row.kind, task, row.lanes))}
        if row.kind != "single":
            pool = pools.get((task, min(row.lanes, MANY)), [])
            peers["envpool"] = pool[-1] if pool else None
            peers[FASTEST] = max(pool, key=lambda r: r.steps_per_second or 0.0, default=None)
        for name, peer in peers.items():
            if row.steps_per_second and peer is not None and peer.steps_per_second:
                row.ratios[name] = row.steps_per_second / peer.steps_per_second
    return rows


def cells(row: Row) -> list[str]:
    """A row of the printed table."""
    rate = row.steps_per_second
    ratios = [f"{row.ratios[name]:.2f}" if name in row.ratios else "" for name in PEERS]
    return [
        row.kind, row.environment, row.package, row.detail, str(row.lanes),
        "not installed" if rate is None else f"{rate:,.0f}", *ratios,
    ]  # fmt: skip


def main() -> None:
    """Print the table; write JSON where asked."""
    parser = results.parser(__doc__, file=True)
    parser.add_argument("--only", nargs="+", choices=KINDS, default=list(KINDS), metavar="KIND")
    parser.add_argument("--seconds", type=float, default=2.0, help="time per row, s")
    arguments = parser.parse_args()
    rows = compared(list(measure(arguments.only, arguments.seconds)))
    header = (
        "kind", "environment", "package", "", "lanes", "steps/s", *(f"/ {name}" for name in PEERS),
    )  # fmt: skip
    results.print_table(header, map(cells, rows))
    content = {"rows": [asdict(row) for row in rows]}
    print_judged("env_throughput", content)
    results.write(arguments.json, content, PACKAGES)


if __name__ == "__main__":
    main()
