"""What a census found, in words and on a page: one HTML file that opens offline."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from integ_gym.support.pages import page_parts, page_template
from integ_gym.support.terminal import compact_percent, plural, step

Json = Mapping[str, Any]

UNKNOWN: Final = "no known map"

EXACT: Final = 1e-9
"""Energy errors below this share are not said to the digit."""

PLANTS: Final = {"pendulum": "pendulum", "cart_pole": "cart-pole"}

SUPERSCRIPT: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

UNITS: Final = {"pendulum": " rad/s", "cart_pole": " m/s, rad/s"}
"""Of speeds."""

FLOOR: Final = 1e-10
"""Left end of the axis of energy errors."""

WIDE, HIGH, EDGE = 300.0, 96.0, 4.0
"""Size of a drawing of energy over time, and its margin."""


def applied(line: Json) -> str:
    """The map that was found."""
    return str(line["found"]["map"]) if line["found"]["identified"] else UNKNOWN


def found_steps(line: Json) -> str:
    """The steps that were found; none of what was not identified."""
    return _steps(line["found"]) if line["found"]["identified"] else "–"


def stated(line: Json) -> str:
    """The integrator and the steps that are stated."""
    words, period = line["stated"]["words"], _steps(line["stated"])
    return f"{words}, {period}" if words else period


def _steps(period: Json) -> str:
    """A control period by its steps, in seconds."""
    count, dt = period["substeps"], step(period["dt"])
    return f"{count} × {dt} s" if count > 1 else f"{dt} s"


def error(value: float | None) -> str:
    """An error as a power of ten."""
    if value is None:
        return "–"
    return f"{value:.0e}" if value else "0"


def format_drift(value: float | None, sign: bool = False) -> str:
    """A relative energy error in per cent."""
    if value is None:
        return "diverged"
    return "< 10⁻⁷ %" if abs(value) < EXACT else compact_percent(value, sign=sign)


def energy(line: Json) -> tuple[str, str]:
    """Energy error at the end of the free motion, and the largest."""
    drift = line["drift"]
    if drift is None:
        return "not seen", "not seen"
    return format_drift(drift["end"], sign=True), format_drift(drift["largest"])


def speed_limit(line: Json, unit: str = "") -> str:
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


def row(line: Json) -> dict[str, str]:
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


WORDS: Final = (applied, found_steps, stated, error, format_drift, energy, speed_limit)
"""What the page's template says lines with."""


def render_census(document: Json) -> str:
    """The page of the content of ``census.json``.

    Raises:
        ModuleNotFoundError: if jinja2 is not installed, with the command that installs it.
    """
    lines = document["lines"]
    published = [line for line in lines if line["published"]]
    engines = {(line["source"], line["name"]) for line in lines if not line["published"]}
    maps = {line["found"]["map"] for line in lines if line["found"]["identified"]}
    counted = (
        (len(published), "published environment", "published environments"),
        (len(engines), "integrator of engines", "integrators of engines"),
        (len(maps), "one-step map found", "different one-step maps found"),
    )
    text: str = page_template(str(__package__), "census.html.j2").render(
        **page_parts(),
        **{words.__name__: words for words in WORDS},
        document=document,
        answer=_answer(published),
        tiles=[
            *(tuple(plural(*counts).split(" ", 1)) for counts in counted),
            (str(sum(bool(line["differences"]) for line in lines)), "not as said"),
            (str(len(document["missing"])), "not installed here"),
        ],
        plants=[
            _plant(own, name, title)
            for name, title in PLANTS.items()
            if (own := [line for line in lines if line["plant"] == name])
        ],
        plural=plural,
    )
    return text


def _answer(published: Sequence[Json]) -> str:
    """What the published environments of each name have in common, in one sentence each."""
    said = []
    for name, title in PLANTS.items():
        lines = [line for line in published if line["plant"] == name]
        if not lines:
            continue
        kinds = {(applied(line), found_steps(line)) for line in lines}
        largest = [line["drift"]["largest"] for line in lines if line["drift"]]
        errors = [x for x in largest if x is not None]
        off = ""
        if errors:
            ends = dict.fromkeys(format_drift(x) for x in (min(errors), max(errors)))
            off = f"; the energy of 10 s of free motion is off by {' to '.join(ends)}"
        said.append(
            f"{plural(len(lines), f'published {title}')} {'takes' if len(lines) == 1 else 'take'} "
            f"{plural(len(kinds), 'different step' if len(kinds) > 1 else 'step')}{off}."
        )
    return " ".join(said) or "What every step of an engine is, found from outside."


def _plant(lines: Sequence[Json], name: str, title: str) -> Json:
    engines = [line for line in lines if not line["published"]]
    published = [line for line in lines if line["published"]]
    # Those with the same control period beside each other.
    by_period = sorted(published, key=lambda x: (-x["stated"]["control_period"], x["source"]))
    groups = [
        _group(applies, [line for line in engines if applied(line) == applies], published)
        for applies in dict.fromkeys(map(applied, engines))
    ]
    return {
        "name": name,
        "title": title,
        "lines": lines,
        "cards": [_card(line) for line in by_period],
        "groups": sorted(groups, key=lambda group: -group["largest"][1]),
        "axis": _axis(engines),
        "dt": engines[0]["stated"]["dt"] if engines else None,
    }


def _card(line: Json) -> Json:
    """A published environment."""
    end, largest = energy(line)
    found, drift = line["found"], line["drift"]
    tone, mark, word = "transfers", "✓", "as said"
    if not found["identified"]:
        tone, mark, word = "fails", "?", UNKNOWN
    elif line["differences"]:
        tone, mark, word = "fails", "✕", "not as said"
    elif line["stated"]["map"] is None:
        tone, mark, word = "inconclusive", "○", "names no integrator"
    weight = "gravity's torque" if line["plant"] == "pendulum" else "the weight"
    return {
        "line": line,
        "tone": tone,
        "mark": mark,
        "word": word,
        "curve": _curve(drift) if drift else None,
        "facts": [
            ("says", stated(line)),
            ("off that map by", error(found["defect"]) if found["identified"] else "–"),
            ("off the truth by", error(found["truth_defect"])),
            ("energy error at 10 s", end),
            ("largest", largest),
            ("speed limit", speed_limit(line, UNITS[line["plant"]])),
            ("small swings take", f"{line['swing_period']:.3g} s"),
            ("strongest control", f"{compact_percent(line['authority'], 3)} of {weight}"),
        ],
    }


def _curve(drift: Json) -> Json:
    """Energy over time, and the exact one, as points of a drawing."""
    both = [*drift["energies"], *drift["exact_energies"]]
    top: float = max(1.0, *(x for x in both if x is not None))

    def height(energy: float) -> float:
        return HIGH - EDGE - (HIGH - 2.0 * EDGE) * energy / (1.05 * top)

    def points(energies: Sequence[float | None]) -> str:
        wide = (WIDE - 2.0 * EDGE) / (len(energies) - 1)
        return " ".join(
            f"{EDGE + wide * k:.1f},{height(x):.1f}"
            for k, x in enumerate(energies)
            if x is not None
        )

    return {
        "path": points(drift["energies"]),
        "exact": points(drift["exact_energies"]),
        "top": top,
        "one": height(1.0),
    }


def _group(name: str, lines: Sequence[Json], published: Sequence[Json]) -> dict[str, Any]:
    """Engines' integrators that apply one map, and the published environments that do, too."""
    first, errors = lines[0], [line["drift"]["largest"] for line in lines]
    known = [math.inf if x is None else x for x in errors]
    return {
        "map": name,
        "lines": lines,
        "largest": (min(known), max(known)),
        "end": first["drift"]["end"],
        "defect": max(line["found"]["defect"] for line in lines),
        "truth_defect": max(line["found"]["truth_defect"] for line in lines),
        "published": [
            line
            for line in published
            if line["found"]["identified"]
            and line["parameters"] == first["parameters"]
            and line["found"]["map"] == first["found"]["map"]
            and math.isclose(line["found"]["dt"], first["found"]["dt"], rel_tol=1e-6)
        ],
    }


def _axis(engines: Sequence[Json]) -> Json:
    """A logarithmic axis for the largest energy errors."""
    errors = [line["drift"]["largest"] for line in engines]
    high = math.ceil(math.log10(max([1.0, *(x for x in errors if x is not None)])))
    low = round(math.log10(FLOOR))

    def at(value: float) -> float:
        power = math.log10(min(max(value, FLOOR), 10.0**high))
        return round(3.0 + 94.0 * (power - low) / (high - low), 2)

    def tick(power: int) -> str:
        """A power of ten, in per cent."""
        small = abs(power) <= 2
        return f"{10.0**power:g} %" if small else f"10{str(power).translate(SUPERSCRIPT)} %"

    ticks = [(at(10.0**power), tick(power + 2)) for power in range(low, high + 1, 2)]
    return {"at": at, "ticks": ticks}
