"""``integ-gym engines``: which engines are installed, and what their integrators really are."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import Any

from integ_gym.envs.engines import ENGINES
from integ_gym.envs.engines._stepped import CONSTRAINT_VIOLATION
from integ_gym.envs.extras import missing_modules
from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.envs.numerics.fingerprint import Fingerprint, fingerprint
from integ_gym.envs.parameters import unknown_name
from integ_gym.evidence.command_line import CommandParser
from integ_gym.evidence.extra import pyarrow
from integ_gym.evidence.print_table import print_table

EXAMPLES = """\
examples:
  integ-gym engines
  integ-gym engines --engine mujoco drake --plant cart_pole
  integ-gym engines --json
"""

EXACT = "exact"
"""Order of an integrator whose errors are rounding alone."""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    made = CommandParser(
        prog="integ-gym engines",
        description="Measure, from outside, which one-step map every integrator of every installed "
        "engine applies, and say what is not installed. APPLIES is the known map that is nearest, "
        "with the largest error of one step against it, with and without control and damping; "
        "DET J - 1 is what a step of 0.02 s without damping adds to a small volume of phase space, "
        "FREQUENCY and ENERGY what such steps do to small oscillations.",
        epilog=EXAMPLES,
    )
    made.add_argument("--engine", nargs="+", default=[], metavar="NAME", help="default: all")
    made.add_argument(
        "--plant", choices=("pendulum", "cart_pole"), default="cart_pole", help="default: cart_pole"
    )
    made.add_argument("--json", action="store_true", help="print everything measured, as JSON")
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    names = _chosen(given.engine)
    installed = [name for name in names if not missing_modules(name)]
    measured = []
    for name in installed:
        print(f"measuring {name} …", file=sys.stderr)
        measured += [fingerprint(name, own, given.plant) for own in integrators_of(name)]
    absent = [name for name in names if name not in installed]
    if given.json:
        print(json.dumps(_document(measured, absent), indent=2))
    else:
        print_table(_table(measured), sys.stdout)
        if installed:
            print(f"\nconstraint violation: {CONSTRAINT_VIOLATION}")
        for line in _remedies(absent):
            print(line)
    return 0


def integrators_of(engine: str) -> tuple[str, ...]:
    """The integrators of an engine, as it calls them; ours without the exact one."""
    own = getattr(ENGINES.load(engine), "maps", None)
    return tuple(own) if own else tuple(n for n in INTEGRATORS.names() if n != "reference")


def _chosen(names: Sequence[str]) -> list[str]:
    for name in names:
        if name not in ENGINES.names():
            raise ValueError(unknown_name("engine", name, ENGINES.names()))
    others = [name for name in ENGINES.names() if name != "native"]
    return list(names) or ["native", *others]


def _table(measured: Sequence[Fingerprint]) -> Any:
    rows = [
        {
            "engine": f.engine,
            "version": f.version,
            "integrator": f.integrator,
            "applies": f.map,
            "defect": f"{max(f.defects.values()):.0e}",
            "det J - 1": f"{f.volume_defect:+.0e}",
            "order": EXACT if f.order is None else f"{f.order:.2f}",
            "frequency": _percent(f.frequency_shift, 3, "%"),
            "energy": _percent(f.energy_rate, 2, "%/s"),
            "bits": f.width,
            "own stops": _own_stops(f.engine, f.integrator),
        }
        for f in measured
    ]
    return pyarrow().Table.from_pylist(rows)


def _own_stops(engine: str, integrator: str) -> str:
    owner = ENGINES.load(engine)
    return "yes" if owner.own_stops and integrator not in owner.stopless else "no"


def _percent(share: float, digits: int, unit: str) -> str:
    """With a sign where it does not round to zero."""
    shown = round(100.0 * share, digits)
    return f"{shown:+.{digits}f} {unit}" if shown else f"0 {unit}"


def _remedies(absent: Sequence[str]) -> list[str]:
    return [
        f"{name}: not installed ({', '.join(missing_modules(name))}); "
        f'run: pip install "integ-gym[{name}]"'
        for name in absent
    ]


def _document(measured: Sequence[Fingerprint], absent: Sequence[str]) -> dict[str, Any]:
    return {
        "constraint_violation": CONSTRAINT_VIOLATION,
        "installed": [found.to_json() for found in measured],
        "missing": {
            name: {"modules": missing_modules(name), "install": f"integ-gym[{name}]"}
            for name in absent
        },
    }
