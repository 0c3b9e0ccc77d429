"""Cells with other package versions: the interpreters they need, and whether they can be there."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from integ_gym.support import interpreters
from integ_gym.support.errors import IntegGymError, describe_exception
from integ_gym.support.terminal import print_wrapped
from integ_gym.train.policy import Policy
from integ_gym.train.policy_files.programs import ProgramPolicy

from .cells import Cell, environments_of
from .spec import PanelSpec

_LARGE = ("torch", "jax", "tensorflow")
"""Packages that a policy may need and that take long to install, which is said."""


def other_packages(cells: Iterable[Cell]) -> list[tuple[str, ...]]:
    """Versions of packages in some cells that are not those of this interpreter."""
    listed = dict.fromkeys(cell.packages for cell in cells)
    return [packages for packages in listed if not interpreters.are_running(packages)]


def versions_for_evaluation(
    spec: PanelSpec, cells: Iterable[Cell], policies: Sequence[Policy]
) -> dict[str, str]:
    """Versions, as they are here, of what the evaluation of policies in cells imports."""
    names = [spec.env_id.partition(":")[0], *sorted({cell.engine for cell in cells})]
    names += [policy.extra for policy in policies if isinstance(policy, ProgramPolicy)]
    return interpreters.needed_versions(names, interpreters.modules_in(policies))


def interpreter_for(
    packages: Sequence[str], spec: PanelSpec, cells: Iterable[Cell], policies: Sequence[Policy]
) -> interpreters.Interpreter:
    """The interpreter of cells with these packages; see :func:`make_interpreter`."""
    return interpreters.make_interpreter(packages, versions_for_evaluation(spec, cells, policies))


def interpreters_of(spec: PanelSpec) -> dict[tuple[str, ...], bool]:
    """Packages that a panel's cells ask for, and whether there is an interpreter with them."""
    cells = all_cells(spec)
    return {
        packages: interpreters.find_interpreter(packages, versions_for_evaluation(spec, cells, ()))
        is not None
        for packages in other_packages(cells)
    }


def all_cells(spec: PanelSpec) -> list[Cell]:
    """Cells of all rows and of the baselines, each once."""
    return list(spec.cells_by_name((*spec.train, None)).values())


def make_interpreters(
    spec: PanelSpec, cells: Sequence[Cell], policies: Sequence[Policy], progress: bool
) -> None:
    """Make the interpreters that cells need, and their environments in each, once.

    Args:
        spec: the panel.
        cells: of it.
        policies: that are evaluated, as far as they are there.
        progress: say on standard error what is being done.

    Raises:
        InterpreterError: for an interpreter that cannot be made, or a cell that cannot be there.
    """
    asked = other_packages(cells)
    if not asked:
        return
    needed = versions_for_evaluation(spec, cells, policies)
    large = [f"{name} {needed[name]}" for name in _LARGE if name in needed]
    also = f", with {', '.join(large)}, which the policy needs" if large else ""

    def tell(words: str) -> None:
        if progress:
            print_wrapped(f"{words[0].upper()}{words[1:]}{also} …", sys.stderr)

    for packages in asked:
        begin, reported = time.monotonic(), list[str]()

        def report(words: str, reported: list[str] = reported) -> None:
            reported.append(words)
            tell(words)

        interpreter = interpreters.make_interpreter(packages, needed, report)
        if reported:
            tell(f"made after {time.monotonic() - begin:.0f} s")
        there = [cell for cell in cells if cell.packages == packages]
        for fault in interpreters.call_there(interpreter, faults_of, spec, there):
            raise interpreters.InterpreterError(fault)


def faults_of(spec: PanelSpec, cells: Sequence[Cell]) -> Iterator[str]:
    """Cells whose environments cannot be made here, in sentences."""
    for cell in cells:
        try:
            environments: Any = environments_of(spec.testbed, cell, 1)
            environments.reset(seed=[0])
            environments.close()
        except (IntegGymError, AttributeError, TypeError, ValueError) as error:
            own = isinstance(error, IntegGymError)
            said = str(error) if own else describe_exception(error)
            lacks = "" if own else f"{' '.join(cell.packages)} lacks what integ-gym asks of it: "
            yield f"there is no cell {cell.name!r}: {lacks}{said}; leave it out, or give others"
