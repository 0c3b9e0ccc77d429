"""How the terminal and the page say what a line holds; lines as ``census.json`` has them."""

from __future__ import annotations

from typing import Any

from integ_gym.support.terminal import compact_percent, step

UNKNOWN = "no known map"
EXACT = 1e-9
"""Energy errors below this share are not said to the digit."""


def applied(line: dict[str, Any]) -> str:
    """The map that was found."""
    return str(line["found"]["map"]) if line["found"]["identified"] else UNKNOWN


def steps(substeps: int, dt: float) -> str:
    """A control period by its steps, in seconds."""
    return f"{substeps} × {step(dt)} s" if substeps > 1 else f"{step(dt)} s"


def found_steps(line: dict[str, Any]) -> str:
    """The steps that were found; none of what was not identified."""
    found = line["found"]
    return steps(found["substeps"], found["dt"]) if found["identified"] else "–"


def stated(line: dict[str, Any]) -> str:
    """The integrator and the steps that are stated."""
    said = line["stated"]
    period = steps(said["substeps"], said["dt"])
    return f"{said['words']}, {period}" if said["words"] else period


def error(value: float | None) -> str:
    """An error as a power of ten."""
    if value is None:
        return "–"
    return f"{value:.0e}" if value else "0"


def drifted(value: float | None, sign: bool = False) -> str:
    """A relative energy error in per cent."""
    if value is None:
        return "diverged"
    return "< 10⁻⁷ %" if abs(value) < EXACT else compact_percent(value, sign=sign)


def energy(line: dict[str, Any]) -> tuple[str, str]:
    """Energy error at the end of the free motion, and the largest."""
    drift = line["drift"]
    if drift is None:
        return "not seen", "not seen"
    return drifted(drift["end"], sign=True), drifted(drift["largest"])


def speed_limit(line: dict[str, Any], unit: str = "") -> str:
    """What was found of a speed limit."""
    limit = line["speed_limit"]
    if limit is None:
        return "–"
    if limit["slowed"]:
        return "slowed"
    if limit["limit"] is None:
        return f"none to {limit['fastest']:.3g}{unit}"
    moves = f", moves by the {limit['moves_by']} speed" if limit["moves_by"] else ""
    return f"{limit['limit']:.4g}{unit}{moves}"


def row(line: dict[str, Any]) -> dict[str, str]:
    """A line of the table in the terminal."""
    end, largest = energy(line)
    return {
        "source": line["source"],
        "name": line["name"],
        "applies": applied(line),
        "step": found_steps(line),
        "off by": error(line["found"]["defect"]),
        "off truth by": error(line["found"]["truth_defect"]),
        "energy at end": end,
        "largest": largest,
        "speed limit": speed_limit(line),
        "as said": "no" if line["differences"] else "yes",
    }
