"""Does `integ-gym check` find what was found with other seeds?

    python benchmarks/check_points.py --out runs/check_points
    python benchmarks/check_points.py --out runs/check_points --only 2 5
    python benchmarks/check_points.py --table docs/atlas/check_points.json

Eight settings of the pendulum (hanging start, control period 0.05 s) whose losses were measured
before, with 12 or 8 seeds of their own. A check is right where its interval holds that loss. Each
setting leaves its run and a small JSON file in --out; --save puts these together in one file, of
which --table prints the table in docs/how-to/check.md. What is there is not run again.
"""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from measuring import results

from integ_gym.eval.loss_check import check


class Point(NamedTuple):
    """A setting, and the loss that was found there with other seeds."""

    label: str
    environment: dict[str, float]
    integrator: str
    dt: float
    found: float


WEAK = ("0.62 N m, 11 s", {"max_torque": 0.62, "duration": 11.0})
HEAVY = (
    "2 kg, 0.6 m, 0.85 N m, 9 s",
    {"mass": 2.0, "length": 0.6, "max_torque": 0.85, "duration": 9.0},
)
STRONG = ("1.05 N m, 11 s", {"max_torque": 1.05, "duration": 11.0})
POINTS = (
    Point(*WEAK, "explicit_euler", 0.025, 0.05),
    Point(*WEAK, "symplectic_euler", 0.05, 0.57),
    Point(*WEAK, "symplectic_euler", 0.025, 0.16),
    Point(*HEAVY, "explicit_euler", 0.025, 0.04),
    Point(*HEAVY, "symplectic_euler", 0.05, 0.65),
    Point(*HEAVY, "symplectic_euler", 0.025, 0.32),
    Point(*STRONG, "explicit_euler", 0.025, 0.00),
    Point(*STRONG, "symplectic_euler", 0.05, 0.01),
)


def measured(point: Point, out: Path, workers: int | None) -> dict[str, Any]:
    """What a check of a setting found, and what it took."""
    began, before = time.perf_counter(), _processor_seconds()
    found = check(
        integrator=point.integrator,
        dt=point.dt,
        control_period=0.05,
        environment={"start": "hanging", **point.environment},
        out=out,
        workers=workers,
        progress=False,
        command="python benchmarks/check_points.py",
    )
    return {
        "setting": point.label,
        "integrator": point.integrator,
        "dt": point.dt,
        "seeds": found.seeds,
        "home": round(found.home.success, 4),
        "truth": round(found.truth.success, 4),
        "loss": round(found.loss.estimate, 4),
        "low": round(found.loss.low, 4),
        "high": round(found.loss.high, 4),
        "found": point.found,
        "wall_seconds": round(time.perf_counter() - began, 1),
        "processor_seconds": round(_processor_seconds() - before, 1),
    }


def _processor_seconds() -> float:
    """Of this process and of those that it has waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def table(found: list[dict[str, Any]]) -> Iterator[str]:
    """Every setting beside what was found, as Markdown."""
    yield (
        "| setting | trained on | seeds | home | truth | lost (95 % interval) | found before | "
        "held | processor time |"
    )
    yield "|---" * 9 + "|"
    for one in found:
        loss = f"{one['loss']:z.2f} ({one['low']:z.2f} to {one['high']:z.2f})".replace("-", "−")
        yield (
            f"| {one['setting']} | {one['integrator']}, {one['dt']:g} s | {one['seeds']} | "
            f"{one['home']:.2f} | {one['truth']:.2f} | {loss} | {one['found']:.2f} | "
            f"{'yes' if held(one) else 'no'} | {one['processor_seconds']:.0f} s |"
        )


def held(one: dict[str, Any]) -> bool:
    """Whether a check's interval holds the loss that was found before."""
    return bool(one["low"] <= one["found"] <= one["high"])


def main() -> None:
    """Run what is missing, and print the table."""
    parser = results.parser(__doc__)
    parser.add_argument("--out", type=Path, metavar="DIR")
    parser.add_argument("--only", type=int, nargs="+", metavar="N", help="settings, from 1 on")
    parser.add_argument("--workers", type=int, metavar="N")
    parser.add_argument("--save", type=Path, metavar="FILE")
    parser.add_argument("--table", type=Path, metavar="FILE", help="run nothing")
    given = parser.parse_args()
    if given.table:
        print("\n".join(table(json.loads(given.table.read_text(encoding="utf-8")))))
        return
    if given.out is None:
        parser.error("give --out DIR")
    given.out.mkdir(parents=True, exist_ok=True)
    found = []
    for number in given.only or range(1, len(POINTS) + 1):
        file = given.out / f"{number}.json"
        if not file.exists():
            result = measured(POINTS[number - 1], given.out / str(number), given.workers)
            file.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        found.append(json.loads(file.read_text(encoding="utf-8")))
    print("\n".join(table(found)))
    if given.save:
        given.save.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
