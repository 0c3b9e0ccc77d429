"""What every benchmark prints and writes: tables, and JSON with the machine and versions."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from integ_gym.eval.statistics import SHOWN, Difference, Floats, holm, rate_interval
from integ_gym.support.optional import running_version
from integ_gym.support.processes import cores, instruction_sets
from integ_gym.support.terminal import print_columns


def machine() -> dict[str, Any]:
    """The computer, and how busy it was with other things when asked."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return {
        "platform": platform.platform(),
        "python": platform.python_version(),
        "processor": names[0] if names else platform.processor(),
        "cores": cores(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
    }


def parser(what: str | None, examples: str = "", file: bool = False) -> argparse.ArgumentParser:
    """A benchmark's arguments, by its docstring.

    Args:
        what: the docstring.
        examples: lines for the end of the help.
        file: whether what was measured may be written to a file, ``--json``.
    """
    made = argparse.ArgumentParser(
        description=what, epilog=examples, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    if file:
        made.add_argument("--json", type=Path, metavar="FILE", help="also write the numbers here")
    return made


def print_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Columns under their names, the first flush left."""
    right = [False, *(True for _ in header[1:])]
    print_columns(header, [list(row) for row in rows], sys.stdout, right)


def markdown(header: Sequence[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Lines of a table."""
    lines = [f"| {' | '.join(header)} |", "|---" * len(header) + "|"]
    return lines + [f"| {' | '.join(row)} |" for row in rows]


def join_tables(tables: Iterable[Sequence[str]]) -> str:
    """Tables one below the other, without those that have no rows."""
    return "\n\n".join("\n".join(lines) for lines in tables if len(lines) > 2) + "\n"


def format_success(rates: Sequence[float]) -> str:
    """Mean success of seeds with its 95 % interval, as Markdown; empty where nothing was run."""
    if not rates:
        return ""
    found = rate_interval(rates)
    return f"{found.estimate:.2f} ({found.low:.2f}–{found.high:.2f})"


def format_interval(numbers: Sequence[float | None] | None) -> str:
    """An estimate with its ends, as Markdown says it; a dash where there is none."""
    if numbers is None:
        return "–"
    value, low, high = numbers
    text = f"{value:z.2f}" + ("" if low is None else f" ({low:z.2f} to {high:z.2f})")
    return text.replace("-", "−")


def format_difference(found: Difference, scale: float = 1.0) -> str:
    """A difference of success, or a multiple of it, with its 95 % interval, as Markdown says it."""
    own = found.interval
    ends = (own.estimate, own.low, own.high)
    return format_interval([None if x is None else scale * x for x in ends])


def correct_p_values(differences: Iterable[Difference | None], weight: float = SHOWN) -> Floats:
    """One-sided p-values of one family of tests, corrected by Holm's method.

    Args:
        differences: of all tests that were declared; None: not run, which counts as p = 1.
        weight: of what was not seen; with 1 it is Gaffke's test, or its like for two groups.
    """
    return holm([1.0 if one is None else one.p_greater(weight=weight) for one in differences])


def format_p_value(value: float | None) -> str:
    """A p-value as Markdown says it; a dash where there is none."""
    if value is None:
        return "–"
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def made_with(packages: Iterable[str]) -> dict[str, Any]:
    """Versions and the processor's instructions, on which trained weights depend."""
    versions = {name: running_version(name) for name in packages}
    return {"versions": versions, "instruction_sets": list(instruction_sets())}


def write(path: Path | None, content: dict[str, Any], packages: Iterable[str]) -> None:
    """Write ``content`` with the machine and versions as JSON; nothing without a path."""
    if path is not None:
        about = {"machine": machine(), **made_with(packages)}
        path.write_text(json.dumps({**content, **about}, indent=1) + "\n", encoding="utf-8")
