"""What every benchmark prints and writes: tables, and JSON with the machine and versions."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from integ_gym.support.processes.workers import cores


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


def versions(packages: Iterable[str]) -> dict[str, str | None]:
    """Installed versions; None where a package is not installed."""
    found: dict[str, str | None] = {}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found


def print_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Columns under their names, the first flush left."""
    cells = [list(header), *(list(row) for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    for first, *others in cells:
        rest = (cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))
        print("  ".join((first.ljust(widths[0]), *rest)))


def interval(numbers: Sequence[float | None] | None) -> str:
    """An estimate with its ends, as Markdown says it; a dash where there is none."""
    if numbers is None:
        return "–"
    value, low, high = numbers
    return minus(f"{value:z.2f}" + ("" if low is None else f" ({low:z.2f} to {high:z.2f})"))


def minus(text: str) -> str:
    """Text with minus signs in place of hyphens."""
    return text.replace("-", "−")


def p_value(value: float | None) -> str:
    """A p-value as Markdown says it; a dash where there is none."""
    if value is None:
        return "–"
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def write(path: Path | None, content: dict[str, Any], packages: Iterable[str]) -> None:
    """Write ``content`` with the machine and versions as JSON; nothing without a path."""
    if path is not None:
        about = {"machine": machine(), "versions": versions(packages)}
        path.write_text(json.dumps({**content, **about}, indent=1) + "\n", encoding="utf-8")
