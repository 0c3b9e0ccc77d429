"""What the sections of a diagnosis share: who is examined, and how lines and curves are kept."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Final

from integ_gym.support.files import replace_file
from integ_gym.support.pages import page_environment, page_parts
from integ_gym.support.terminal import plural

from .bench import Array as Array
from .lines import ANY, NOTHING, VERDICTS
from .terminal import (
    IDENTITY,
    Line,
    identity_cells,
    topics,
)

DIAGNOSIS_PAGE: Final = "diagnose.html"

_CAPTIONS: Final = {
    "energy": "Free motion: change of energy over time",
    "phase_portraits": "Free motion: phase portraits",
    "stability": "Small oscillations: factor on their energy by step",
    "convergence": "Driven motion: error by step",
    "work_precision": "Driven motion: error by work",
    "contact": "Impact: rebound, penetration and ledger by step and stiffness",
}
"""Figure, as far as its name's first part says, to what it shows."""


def write_page(result: Mapping[str, Any], directory: Path) -> Path:
    """Write the page of a diagnosis beside the content that it shows.

    Args:
        result: content of ``diagnose.json``.
        directory: holds ``figures`` too.

    Raises:
        ModuleNotFoundError: if jinja2 is not installed, with the command that installs it.
    """
    lines = result["findings"]
    asked = [line for line in lines if line["holds"] is not None]
    failed = [line for line in asked if not line["holds"]]
    text: str = _template().render(
        **page_parts(),
        result=result,
        answer=_answer(result, asked, failed),
        tiles=[
            _tile(len(result["plants"]), "plant"),
            _tile(len(result["integrators"]), "integrator"),
            _tile(len(asked), "expectation"),
            (f"{len(failed):,}", "do not hold" if len(failed) != 1 else "does not hold"),
            _tile(result["records"], "recorded rollout"),
        ],
        identity=IDENTITY,
        identities=[identity_cells(told) for told in result["identities"]],
        failed=list(topics(failed)),
        figures=_figures(directory / "figures"),
        sections=_sections(lines),
        verdicts=VERDICTS,
        nothing=NOTHING,
        anybody=ANY,
        plural=plural,
    )
    return replace_file(directory / DIAGNOSIS_PAGE, text.encode())


@cache
def _template() -> Any:
    folder = resources.files(__package__)
    return page_environment().from_string(folder.joinpath("diagnose.html.j2").read_text("utf-8"))


def _tile(count: int, noun: str) -> tuple[str, str]:
    number, _, words = plural(count, noun).partition(" ")
    return number, words


def _answer(result: Mapping[str, Any], asked: Sequence[Line], failed: Sequence[Line]) -> str:
    said = (
        f"{len(asked) - len(failed)} of {plural(len(asked), 'expectation')} of "
        f"{plural(len(result['integrators']), 'integrator')} on "
        f"{plural(len(result['plants']), 'plant')} hold."
    )
    if not failed:
        return said
    counts: dict[str, int] = {}
    for line in failed:
        counts[line["integrator"]] = counts.get(line["integrator"], 0) + 1
    worst = sorted(counts, key=lambda name: -counts[name])
    told = ", ".join(f"{name} {counts[name]}" for name in worst)
    return f"{said} What does not, by integrator: {told}."


def _figures(folder: Path) -> list[tuple[str, str, str]]:
    """Name, caption and picture of every figure."""
    found = []
    for name, caption in _CAPTIONS.items():
        for path in sorted(folder.glob(f"{name}*.png")):
            plant = path.stem.removeprefix(name).strip("_").replace("_", " ")
            content = base64.b64encode(path.read_bytes()).decode()
            said = f"{caption}, {plant}" if plant else caption
            found.append((path.stem, said, f"data:image/png;base64,{content}"))
    return found


def _sections(lines: Sequence[Line]) -> list[tuple[str, str, list[tuple[str, list[Line]]]]]:
    """Plant, section and their quantities."""
    places = dict.fromkeys((line["plant"], line["section"]) for line in lines)
    return [(plant, section, list(topics(_of(lines, plant, section)))) for plant, section in places]


def _of(lines: Sequence[Line], plant: str, section: str) -> list[Line]:
    return [x for x in lines if (x["plant"], x["section"]) == (plant, section)]
