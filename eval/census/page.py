"""The page of the census: one HTML file that opens offline and needs nothing beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import Any, Final

from integ_gym.support.pages import page_environment, page_parts
from integ_gym.support.terminal import compact_percent, plural

from . import words

Json = dict[str, Any]

PLANTS: Final = {"pendulum": "pendulum", "cart_pole": "cart-pole"}

SUPERSCRIPT: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

UNITS: Final = {"pendulum": " rad/s", "cart_pole": " m/s, rad/s"}
"""Of speeds."""

FLOOR: Final = 1e-10
"""Left end of the axis of energy errors."""

WIDE, HIGH, EDGE = 300.0, 96.0, 4.0
"""Size of a drawing of energy over time, and its margin."""


def render_census(document: Json) -> str:
    """The page of the content of ``census.json``.

    Raises:
        ModuleNotFoundError: if jinja2 is not installed, with the command that installs it.
    """
    published = [line for line in document["lines"] if line["published"]]
    text: str = _template().render(
        **page_parts(),
        document=document,
        answer=_answer(published),
        tiles=_tiles(document),
        plants=[
            _plant(document, name, title)
            for name, title in PLANTS.items()
            if any(line["plant"] == name for line in document["lines"])
        ],
        words=words,
        plural=plural,
    )
    return text


@cache
def _template() -> Any:
    environment = page_environment()
    folder = resources.files(__package__)
    return environment.from_string(folder.joinpath("census.html.j2").read_text("utf-8"))


def _answer(published: Sequence[Json]) -> str:
    """What the published environments of each name have in common, in one sentence each."""
    said = []
    for name, title in PLANTS.items():
        lines = [line for line in published if line["plant"] == name]
        if not lines:
            continue
        kinds = {(words.applied(line), words.found_steps(line)) for line in lines}
        errors = [line["drift"]["largest"] for line in lines if line["drift"]]
        known = [x for x in errors if x is not None]
        said.append(
            f"{plural(len(lines), f'published {title}')} {'takes' if len(lines) == 1 else 'take'} "
            f"{plural(len(kinds), 'different step' if len(kinds) > 1 else 'step')}{_off(known)}."
        )
    return " ".join(said) or "What every step of an engine is, found from outside."


def _off(errors: Sequence[float]) -> str:
    """Energy errors in a clause; nothing without any."""
    if not errors:
        return ""
    ends = dict.fromkeys(words.drifted(x) for x in (min(errors), max(errors)))
    return f"; the energy of 10 s of free motion is off by {' to '.join(ends)}"


def _tiles(document: Json) -> list[tuple[str, str]]:
    lines = document["lines"]
    published = [line for line in lines if line["published"]]
    engines = {(x["source"], x["name"]) for x in lines if not x["published"]}
    maps = {line["found"]["map"] for line in lines if line["found"]["identified"]}
    return [
        _tile(len(published), "published environment"),
        _tile(len(engines), "integrator of engines", "integrators of engines"),
        _tile(len(maps), "one-step map found", "different one-step maps found"),
        (f"{sum(bool(x['differences']) for x in lines)}", "not as said"),
        (f"{len(document['missing'])}", "not installed here"),
    ]


def _tile(count: int, noun: str, more: str | None = None) -> tuple[str, str]:
    number, _, what = plural(count, noun, more).partition(" ")
    return number, what


def _plant(document: Json, name: str, title: str) -> Json:
    lines = [line for line in document["lines"] if line["plant"] == name]
    published = [line for line in lines if line["published"]]
    engines = [line for line in lines if not line["published"]]
    return {
        "name": name,
        "title": title,
        "lines": lines,
        "cards": [_card(line) for line in sorted(published, key=_kin)],
        "groups": _groups(engines, published),
        "axis": _axis(engines),
        "dt": engines[0]["stated"]["dt"] if engines else None,
    }


# Published environments -------------------------------------------------------------------------


def _kin(line: Json) -> tuple[float, str]:
    """Those with the same control period beside each other."""
    return -line["stated"]["control_period"], line["source"]


def _card(line: Json) -> Json:
    tone, mark, word = _verdict(line)
    end, largest = words.energy(line)
    found, drift = line["found"], line["drift"]
    return {
        "line": line,
        "tone": tone,
        "mark": mark,
        "word": word,
        "curve": _curve(drift) if drift else None,
        "facts": [
            ("says", words.stated(line)),
            ("off that map by", words.error(found["defect"]) if found["identified"] else "–"),
            ("off the truth by", words.error(found["truth_defect"])),
            ("energy error at 10 s", end),
            ("largest", largest),
            ("speed limit", words.speed_limit(line, UNITS[line["plant"]])),
            ("small swings take", f"{line['swing_period']:.3g} s"),
            (
                "strongest control",
                f"{compact_percent(line['authority'], 3)} of "
                + ("gravity's torque" if line["plant"] == "pendulum" else "the weight"),
            ),
        ],
    }


def _verdict(line: Json) -> tuple[str, str, str]:
    if not line["found"]["identified"]:
        return "fails", "?", words.UNKNOWN
    if line["differences"]:
        return "fails", "✕", "not as said"
    if line["stated"]["map"] is None:
        return "inconclusive", "○", "names no integrator"
    return "transfers", "✓", "as said"


def _curve(drift: Json) -> Json:
    """Energy over time, and the exact one, as points of a drawing."""
    both = [*drift["energies"], *drift["exact_energies"]]
    top = max(1.0, *(x for x in both if x is not None))
    return {
        "path": _points(drift["energies"], top),
        "exact": _points(drift["exact_energies"], top),
        "top": top,
        "one": _height(1.0, top),
    }


def _points(energies: Sequence[float | None], top: float) -> str:
    last = len(energies) - 1
    return " ".join(
        f"{EDGE + (WIDE - 2.0 * EDGE) * k / last:.1f},{_height(x, top):.1f}"
        for k, x in enumerate(energies)
        if x is not None
    )


def _height(energy: float, top: float) -> float:
    return HIGH - EDGE - (HIGH - 2.0 * EDGE) * energy / (1.05 * top)


# Engines ----------------------------------------------------------------------------------------


def _groups(engines: Sequence[Json], published: Sequence[Json]) -> list[Json]:
    """Engines' integrators by the map that they apply, by the size of the energy error."""
    maps = dict.fromkeys(words.applied(line) for line in engines)
    groups = [_group(name, [x for x in engines if words.applied(x) == name]) for name in maps]
    for group in groups:
        first = group["lines"][0]
        group["published"] = [
            line
            for line in published
            if line["found"]["identified"]
            and line["parameters"] == first["parameters"]
            and line["found"]["map"] == first["found"]["map"]
            and math.isclose(line["found"]["dt"], first["found"]["dt"], rel_tol=1e-6)
        ]
    return sorted(groups, key=lambda group: -group["largest"][1])


def _group(name: str, lines: list[Json]) -> Json:
    errors = [line["drift"]["largest"] for line in lines]
    known = [math.inf if x is None else x for x in errors]
    return {
        "map": name,
        "lines": lines,
        "largest": (min(known), max(known)),
        "end": lines[0]["drift"]["end"],
        "defect": max(line["found"]["defect"] for line in lines),
        "truth_defect": max(line["found"]["truth_defect"] for line in lines),
    }


def _axis(engines: Sequence[Json]) -> Json:
    """A logarithmic axis for the largest energy errors."""
    errors = [line["drift"]["largest"] for line in engines]
    top = max([1.0, *(x for x in errors if x is not None)])
    high = math.ceil(math.log10(top))
    low = round(math.log10(FLOOR))

    def at(value: float) -> float:
        power = math.log10(min(max(value, FLOOR), 10.0**high))
        return round(3.0 + 94.0 * (power - low) / (high - low), 2)

    ticks = [(at(10.0**power), _tick(power + 2)) for power in range(low, high + 1, 2)]
    return {"at": at, "ticks": ticks}


def _tick(power: int) -> str:
    """A power of ten, in per cent."""
    if abs(power) <= 2:
        return f"{10.0**power:g} %"
    return f"10{str(power).translate(SUPERSCRIPT)} %"
