"""What every benchmark wants, and the bound that each ratio of a run must keep.

    python benchmarks/bounds.py runs/bench

Prints one table of what is wanted and what it was, from the files that the benchmarks wrote. Exits
with 1 and names what was missed if a figure lies beyond its bound, or was not measured. A ratio's
parts are measured in one run; `wanted` is what we are after, and beyond `bound` something has
become slower.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from measuring import results

Content = Mapping[str, Any]
FEW, MANY, SCANNED = 16, 1024, 4096
"""Lanes of arrays, and of compiled rollouts."""


class Bound(NamedTuple):
    """A figure of a benchmark.

    Attributes:
        benchmark: its file's name.
        what: the figure, in words.
        measured: taken from what the benchmark writes; None where a peer is not installed, or the
            part was not run.
        wanted: what we are after.
        bound: what must hold.
        most: whether these are upper limits.
    """

    benchmark: str
    what: str
    measured: Callable[[Content], float | None]
    wanted: float
    bound: float
    most: bool = False

    def verdict(self, value: float | None) -> str:
        """What a value is, in a word or two."""
        if value is None:
            return "not measured"
        sign = -1.0 if self.most else 1.0
        if sign * value >= sign * self.wanted:
            return "met"
        return "within the bound" if sign * value >= sign * self.bound else "MISSED"

    def row(self, value: float | None) -> list[str]:
        """Of the printed table."""
        value_text = "" if value is None else f"{value:.3g}"
        limits = (f"{'≤' if self.most else '≥'} {x:g}" for x in (self.wanted, self.bound))
        return [self.benchmark, self.what, *limits, value_text, self.verdict(value)]


HEADER = ("benchmark", "figure", "wanted", "bound", "measured", "")


def picked(rows: Any, **fields: Any) -> list[Any]:
    """Rows with these values."""
    return [row for row in rows if all(row[name] == value for name, value in fields.items())]


def throughput(
    kind: str, environment: str, detail: str, lanes: int, peer: str, wanted: float, bound: float
) -> Bound:
    """Steps per second of an environment, over a peer's."""

    def measured(content: Content) -> float | None:
        fields = {"environment": environment, "detail": detail, "lanes": lanes}
        found = picked(content["rows"], kind=kind, **fields)
        ratio: float | None = found[0]["ratios"].get(peer) if found else None
        return ratio

    what = " ".join(filter(None, (environment, detail, f"{lanes} lanes" if lanes > 1 else "")))
    return Bound("env_throughput", f"{what} / {peer}", measured, wanted, bound)


def recording(content: Content) -> float | None:
    """Share of the speed that is left while recording with traces, with the writing."""
    rows = content.get("recording", ())
    found = picked(rows, environment=PENDULUM, lanes=MANY, trace=True)
    return float(found[0]["in_all"]) if found else None


def fleet(
    what: str, part: str, peer: str, wanted: float, bound: float, own: str = "fleet"
) -> Bound:
    """Seconds per policy of stable-baselines3, over the fleet's."""

    def measured(content: Content) -> float | None:
        found = content["parts"].get(part)
        if found is None:
            return None
        seconds = found["seconds_per_policy" if part == "panel" else "seconds"]
        return float(seconds[peer] / seconds[own])

    return Bound("panel_cost", what, measured, wanted, bound)


def engine(name: str, steps: int, wanted: float, bound: float) -> Bound:
    """Time of a control period of an environment, over a bare loop's: the slowest row's."""

    def measured(content: Content) -> float | None:
        rows = picked(content["rows"], engine=name, count=steps)
        ratios = [r["ratios"]["bare"][1] for r in rows if r["variant"] in ("", "damped")]
        return max(ratios, default=None)

    return Bound("engines", f"{name}, {steps} steps / bare loop", measured, wanted, bound, True)


def reference(content: Content) -> float | None:
    """RK4 steps that a step of the reference costs where one inner step is enough."""
    rows = picked(content["rows"], inner_steps=1)
    return max((row["rk4_steps"] for row in rows), default=None)


def startup(what: str, name: str, wanted: float, bound: float) -> Bound:
    """Of a whole process."""
    return Bound("startup", what, lambda c: c["figures"].get(name), wanted, bound, True)


PENDULUM, CART_POLE = "IntegPendulum-v0", "IntegCartPole-v0"

BOUNDS = (
    throughput("single", PENDULUM, "", 1, "gymnasium", 1.3, 1.3),
    throughput("single", PENDULUM, "with evidence", 1, "gymnasium", 0.8, 0.8),
    throughput("single", CART_POLE, "", 1, "gymnasium", 1.3, 1.3),
    throughput("single", CART_POLE, "with evidence", 1, "gymnasium", 0.8, 0.8),
    throughput("vector", CART_POLE, "explicit_euler", MANY, "gymnasium", 0.8, 0.5),
    throughput("vector", CART_POLE, "explicit_euler, compiled", MANY, "gymnasium", 0.8, 0.8),
    throughput("vector", PENDULUM, "symplectic_euler", FEW, "fastest envpool", 1.0, 0.7),
    throughput("vector", PENDULUM, "symplectic_euler", MANY, "envpool", 16.0, 10.0),
    throughput("vector", PENDULUM, "symplectic_euler, compiled", MANY, "envpool", 16.0, 16.0),
    throughput("vector", PENDULUM, "rk4", MANY, "envpool", 5.0, 5.0),
    throughput("scan", PENDULUM, "symplectic_euler", SCANNED, "envpool", 60.0, 60.0),
    Bound(
        "evidence_cost", f"{PENDULUM} {MANY} lanes, recorded with traces / without", recording,
        0.4, 0.09,
    ),
    fleet("policies / one process of stable-baselines3's", "panel", "sb3", 60.0, 35.0),
    fleet("policies / one process per core's", "panel", "sb3 per core", 10.0, 10.0),
    fleet(
        "the same with compiled programs / one process", "panel", "sb3", 60.0, 45.0,
        "fleet, compiled before",
    ),
    fleet("one policy on one core / stable-baselines3's", "single", "sb3", 15.0, 15.0),
    engine("mujoco", 1, 3.0, 3.0),
    engine("mujoco", 20, 1.3, 1.6),  # RK4 with damping: docs/reference/engines.md
    engine("drake", 1, 1.5, 1.5),
    engine("drake", 20, 1.5, 1.5),
    Bound("reference_cost", "reference / RK4 step", reference, 20.0, 20.0, True),
    startup("integ-gym --help / import gymnasium", "help", 1.3, 1.3),
    startup("import integ_gym / import gymnasium", "import", 1.3, 1.3),
    startup("one fleet policy, whole process, s", "policy", 6.0, 8.0),
    startup("the same / its training alone", "policy over training", 2.0, 2.5),
)  # fmt: skip


def print_judged(benchmark: str, content: Content) -> None:
    """The table of a benchmark's own figures, as far as they were measured."""
    rows = [bound.row(value) for bound, value in judged(benchmark, content) if value is not None]
    if rows:
        print()
        results.print_table(HEADER, rows)


def judged(benchmark: str, content: Content) -> Iterator[tuple[Bound, float | None]]:
    """The figures of a benchmark, and what they were found to be."""
    for bound in BOUNDS:
        if bound.benchmark == benchmark:
            yield bound, bound.measured(content)


def main() -> int:
    """Print the table; 0 if every bound holds."""
    parser = results.parser(__doc__)
    parser.add_argument("folder", type=Path, help="of the JSON files, named for the benchmarks")
    folder = parser.parse_args().folder
    rows, missed = [], []
    for benchmark in dict.fromkeys(bound.benchmark for bound in BOUNDS):
        file = folder / f"{benchmark}.json"
        if not file.exists():
            parser.error(f"there is no {file}; run `make bench`")
        for bound, value in judged(benchmark, json.loads(file.read_text(encoding="utf-8"))):
            rows.append(bound.row(value))
            if bound.verdict(value) in ("MISSED", "not measured"):
                missed.append(f"{bound.what} ({bound.verdict(value)})")
    results.print_table(HEADER, rows)
    if missed:
        print(f"\nMISSED: {'; '.join(missed)}", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
