"""``integ-gym engines``: which engines are installed, and what their integrators really are."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from integ_gym.envs import numerics
from integ_gym.envs.engines import stepping
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import ENGINES, PLANTS
from integ_gym.envs.settings import NATIVE
from integ_gym.support.errors import InputError
from integ_gym.support.optional import install_command
from integ_gym.support.options import CommandParser
from integ_gym.support.parameters import unknown_name
from integ_gym.support.terminal import FITS, keep_on_one_line, print_columns, print_wrapped

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
    arguments = CommandParser(
        prog="integ-gym engines",
        description="Measure, from outside, which one-step map every integrator of every installed "
        "engine applies, and say what is not installed. APPLIES is the known map that is nearest. "
        "OFF BY is the largest error of one step against it, with and without control and damping. "
        "Three columns are of steps of 0.02 s without damping: DET J - 1 is by what share a step "
        "enlarges a small volume of phase space, FREQUENCY and ENERGY say what such steps do to "
        "small oscillations. OWN STOPS says whether the engine has joint stops. A second table has "
        f"the solver settings that the argument `solver` can change, with their values. {FITS}",
        epilog=EXAMPLES,
    )
    arguments.add_argument("--engine", nargs="+", default=[], metavar="NAME", help="default: all")
    arguments.add_argument(
        "--plant", choices=("pendulum", "cart_pole"), default="cart_pole", help="default: cart_pole"
    )
    arguments.add_argument("--json", action="store_true", help="print everything measured, as JSON")
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    names = chosen_engines(given.engine)
    installed = [name for name in names if not stepping.missing_modules(name)]
    measured = []
    for name in installed:
        print(f"measuring {name} …", file=sys.stderr)
        measured += [
            numerics.fingerprint(name, own, given.plant) for own in stepping.integrators_of(name)
        ]
    absent = [name for name in names if name not in installed]
    if given.json:
        print(json.dumps(_document(measured, absent, _solvers(installed)), indent=2))
    else:
        if installed:
            rows = [_row(found) for found in measured]
            right = [name in _NUMBERS for name in rows[0]]
            cells = [list(row.values()) for row in rows]
            print_columns(list(rows[0]), cells, right=right, optional=_OPTIONAL)
            print()
            for line in _solver_lines(installed):
                print_wrapped(line)
            print_wrapped(f"constraint violation: {stepping.CONSTRAINT_VIOLATION}")
        for name in absent:
            missing = ", ".join(stepping.missing_modules(name))
            remedy = keep_on_one_line(install_command(name))
            print_wrapped(f"{name}: not installed ({missing}); run: {remedy}")
    return 0


def chosen_engines(names: Sequence[str] | None) -> Sequence[str]:
    """Engines of some names; without any all, the native one first.

    Raises:
        ValueError: for a name that is no engine's.
    """
    for name in names or ():
        if name not in ENGINES:
            raise InputError(unknown_name("engine", name, ENGINES.names()))
    return names or sorted(ENGINES.names(), key=lambda name: name != NATIVE)


_OPTIONAL = ("det J - 1", "own stops", "bits", "version")
_NUMBERS = ("off by", "det J - 1", "order", "frequency %", "energy %/s", "bits")


def _row(found: numerics.Fingerprint) -> dict[str, str]:
    return {
        "engine": found.engine,
        "version": found.version,
        "integrator": found.integrator,
        "applies": found.map,
        "off by": f"{max(found.defects.values()):.0e}",
        "det J - 1": f"{found.volume_defect:+.0e}",
        "order": EXACT if found.order is None else f"{found.order:.2f}",
        "frequency %": _percent(found.frequency_shift, 3),
        "energy %/s": _percent(found.energy_rate, 2),
        "bits": str(found.width),
        "own stops": _own_stops(found.engine, found.integrator),
    }


def _own_stops(engine: str, integrator: str) -> str:
    owner = ENGINES.load(engine)
    return "yes" if owner.own_stops and integrator not in owner.stopless else "no"


def _percent(share: float, digits: int) -> str:
    """With a sign where it does not round to zero."""
    shown = round(100.0 * share, digits)
    return f"{shown:+.{digits}f}" if shown else "0"


def _solvers(installed: Sequence[str]) -> dict[str, dict[str, dict[str, Any]]]:
    """Settings of every integrator's solver, as the engine has them, by engine and integrator."""
    pendulum = PlantSystem(PLANTS.load("pendulum")())
    return {
        engine: {
            own: dict(numerics.engine_of(f"{engine}/{own}", pendulum, 0.02).settings)
            for own in stepping.integrators_of(engine)
        }
        for engine in installed
    }


def _solver_lines(installed: Sequence[str]) -> Iterator[str]:
    """What can be given as `solver`, a line for all integrators of an engine that have the same."""
    for engine, found in _solvers(installed).items():
        alike: dict[str, list[str]] = {}
        for integrator, settings in found.items():
            words = ", ".join(f"{name}={value}" for name, value in settings.items())
            alike.setdefault(words, []).append(integrator)
        for words, integrators in alike.items():
            if words:
                yield f"`solver` of {engine} ({', '.join(integrators)}): {words}"


def _document(
    measured: Sequence[numerics.Fingerprint],
    absent: Sequence[str],
    solvers: Mapping[str, Mapping[str, Mapping[str, Any]]],
) -> dict[str, Any]:
    return {
        "constraint_violation": stepping.CONSTRAINT_VIOLATION,
        "solver": solvers,
        "installed": [found.to_json() for found in measured],
        "missing": {
            name: {"modules": stepping.missing_modules(name), "install": install_command(name)}
            for name in absent
        },
    }
