"""``integ-gym diagnose``: what each integrator does to each plant, against theory."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from integ_gym.envs.extras import require
from integ_gym.envs.registration import ENVIRONMENTS
from integ_gym.eval.diagnosis.finding import VERDICTS, Finding
from integ_gym.eval.diagnosis.run import Request, diagnose
from integ_gym.eval.drift_example import drift_example
from integ_gym.evidence.command_line import CommandParser
from integ_gym.evidence.extra import pyarrow
from integ_gym.evidence.print_table import print_table
from integ_gym.train.worker import cores

EXAMPLES = """\
examples:
  integ-gym diagnose --out runs/diagnose
                                  every integrator on every plant, in under two minutes
  integ-gym diagnose --plant pendulum --integrator rk4 --dt 0.02 --out runs/rk4
  integ-gym diagnose --plant pendulum --integrator my_module:Heun --out runs/heun
                                  an integrator of your own is told what it is
  integ-gym diagnose --plant my_module:Slider --out runs/slider
  integ-gym diagnose --example drift --out runs/drift
                                  energy drift over 200 s, see docs/drift.md
"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    made = CommandParser(
        prog="integ-gym diagnose",
        description="Measure what integrators do to plants: identity, free motion, stiffness, "
        "damping, friction, contact, actuation, timestep refinement and latency. Every line says "
        "what was measured, what theory expects and whether it holds; DIR gets diagnose.json, "
        "figures and one evidence record per rollout.",
        epilog=EXAMPLES,
    )
    add = made.add_argument
    add("--env", choices=list(ENVIRONMENTS), help="diagnose the plant of this environment")
    add("--plant", metavar="NAME", help="a plant, or module:Class of your own; default: all")
    add(
        "--integrator", nargs="+", action="extend", default=[], metavar="NAME",
        help="integrators, or module:Class of your own; default: all",
    )  # fmt: skip
    add(
        "--dt", nargs="+", action="extend", default=[], type=float, metavar="S",
        help="integration steps, s; one is halved twice; the largest is the control period",
    )  # fmt: skip
    add("--example", choices=("drift",), help="a worked example instead")
    add(
        "--out", type=Path, metavar="DIR",
        help="where results go; for --example by default runs/NAME",
    )  # fmt: skip
    add("--workers", type=int, metavar="N", help="processes; default: one per core")
    add("--no-progress", action="store_true", help="show no progress bar")
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    made = parser()
    given = made.parse_args(argv)
    if given.out is None:
        if not given.example:
            made.error("the following arguments are required: --out")
        given.out = Path("runs") / given.example
    require("train", "report", "evidence")
    with _importable_here():
        if given.example:
            return _example(given)
        return _diagnose(given, sys.argv[2:] if argv is None else argv)


def _diagnose(given: argparse.Namespace, argv: Sequence[str]) -> int:
    if given.workers is not None and given.workers < 1:
        raise ValueError(f"--workers must be 1 or above, got {given.workers}")
    request = Request(given.env, given.plant, given.integrator, given.dt)
    result = diagnose(
        request,
        given.out,
        shlex.join(["integ-gym", "diagnose", *argv]),
        given.workers or cores(),
        progress=not given.no_progress,
    )
    _print(result)
    print(f"Results: {given.out.resolve()}")
    return 0


def _example(given: argparse.Namespace) -> int:
    for name in ("env", "plant", "integrator", "dt"):
        if getattr(given, name):
            raise ValueError(f"--example drift has its own settings; leave --{name} out")
    pendulum, cart_pole, picture = drift_example(given.out)
    _table(pendulum)
    _table(cart_pole)
    print(f"Figure: {picture.resolve()}")
    return 0


def _print(result: dict[str, Any]) -> None:
    findings = [_finding(line) for line in result["findings"]]
    for topic in dict.fromkeys(map(_topic, findings)):
        lines = [f for f in findings if _topic(f) == topic]
        steps = max((f.steps for f in lines), key=len)
        print(f"\n{topic}{f' (dt {_listed(steps)} s)' if steps else ''}")
        _table([_row(f) for f in lines])
    print()
    for integrator in result["integrators"]:
        print(integrator["is"])
    failed = [f for f in findings if f.holds is False]
    asked = [f for f in findings if f.holds is not None]
    print(f"\n{len(asked) - len(failed)} of {len(asked)} expectations hold.")
    if failed:
        print("These do not:")
        _table([{"what": _topic(f), **_row(f)} for f in failed])


def _finding(line: dict[str, Any]) -> Finding:
    measured = line["measured"]
    if not isinstance(measured, str):
        measured = tuple(math.inf if x is None else x for x in measured)
    return Finding(**{**line, "measured": measured, "steps": tuple(line["steps"])})


def _topic(finding: Finding) -> str:
    return f"{finding.section}, {finding.plant}: {finding.quantity}"


def _listed(steps: Sequence[float]) -> str:
    return ", ".join(f"{step:.4g}" for step in steps)


def _row(finding: Finding) -> dict[str, str]:
    return {
        "integrator": finding.integrator,
        "measured": finding.words(),
        "expected": finding.expected,
        "holds": VERDICTS[finding.holds],
    }


def _table(rows: list[dict[str, str]]) -> None:
    print_table(pyarrow().Table.from_pylist(rows), sys.stdout)


@contextmanager
def _importable_here() -> Iterator[None]:
    """Find ``module:Class`` in the working directory, as ``python -m`` does."""
    here = str(Path.cwd())
    sys.path.insert(0, here)
    try:
        yield
    finally:
        sys.path.remove(here)
