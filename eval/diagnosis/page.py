"""A diagnosis as text and as a page: what everybody is, what does not hold, and every line."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TextIO

from integ_gym.support.files import replace_file
from integ_gym.support.pages import page_parts, page_template
from integ_gym.support.terminal import (
    hanging_indent,
    plural,
    print_columns,
    print_wrapped,
    width_of,
)

from .lines import ANY, NOTHING, VERDICTS

DIAGNOSIS_PAGE: Final = "diagnose.html"

IDENTITY: Final = (
    "plant", "integrator", "order", "symplectic", "reversible", "oscillations stable up to"
)  # fmt: skip
"""Names of what is identity of an integrator on a plant."""

_CAPTIONS: Final = {
    "energy": "Free motion: change of energy over time",
    "phase_portraits": "Free motion: phase portraits",
    "stability": "Small oscillations: factor on their energy by step",
    "convergence": "Driven motion: error by step",
    "work_precision": "Driven motion: error by work",
    "contact": "Impact: rebound, penetration and ledger by step and stiffness",
}
"""Figure, as far as its name's first part says, to what it shows."""

_NAME: Final = 17
"""Characters of the longest name of a built-in integrator."""

Line = Mapping[str, Any]
"""A finding as ``diagnose.json`` has it."""


def print_diagnosis(result: Mapping[str, Any], file: TextIO, *, every_line: bool = False) -> None:
    """Print the content of ``diagnose.json``.

    Args:
        result: the content.
        file: where to.
        every_line: whether to print every line as well, and how many hold by section.
    """
    lines = result["findings"]
    asked, failed = _split_judged(lines)
    print("What they are", file=file)
    print_columns(IDENTITY, [_identity_cells(identity) for identity in result["identities"]], file)
    print(f"\n{len(asked) - len(failed)} of {len(asked)} expectations hold.", file=file)
    if failed:
        print_wrapped("These do not hold for an integrator at this step on this plant:", file)
    for title, topic in _topics(failed):
        print(file=file)
        print_wrapped(title, file)
        for wanted, own in _group(topic, _expectation):
            print_wrapped(f"expected {wanted}", file, indent="  ")
            for line in own:
                name = f"    {line['integrator']:<{_NAME}} "
                print(hanging_indent(name, line["shown"], width_of(file)), file=file)
    if not every_line:
        return
    for title, topic in _topics(lines):
        print(file=file)
        print_wrapped(title, file)
        rows = [
            (line["integrator"], line["shown"], line["expected"], line["tolerance"],
             VERDICTS[line["holds"]])
            for line in topic
        ]  # fmt: skip
        print_columns(("integrator", "measured", "expected", "tolerance", "holds"), rows, file)
    _print_counts(asked, file)


def _split_judged(lines: Sequence[Line]) -> tuple[list[Line], list[Line]]:
    """Lines that expect something, and those of them that do not hold."""
    asked = [line for line in lines if line["holds"] is not None]
    return asked, [line for line in asked if not line["holds"]]


def _group(lines: Sequence[Line], key: Any) -> Iterable[tuple[Any, list[Line]]]:
    """Lines of the same key together, in the order of the first of each."""
    groups: dict[Any, list[Line]] = {}
    for line in lines:
        groups.setdefault(key(line), []).append(line)
    return groups.items()


def _topics(lines: Sequence[Line]) -> Iterable[tuple[str, list[Line]]]:
    """Lines on one quantity together, with a title."""
    for key, topic in _group(lines, lambda x: (x["plant"], x["section"], x["quantity"])):
        plant, section, quantity = key
        steps = max((line["steps"] for line in topic), key=len)
        at = f" (dt {', '.join(f'{step:.4g}' for step in steps)} s)" if steps else ""
        yield f"{plant}, {section}: {quantity}{at}", topic


def _expectation(line: Line) -> str:
    tolerance = f"; {line['tolerance']}" if line["tolerance"] != NOTHING else ""
    return f"{line['expected']}{tolerance}"


def _identity_cells(identity: Mapping[str, Any]) -> tuple[str, ...]:
    """What an integrator is on a plant, in words."""
    answers, order = {True: "yes", False: "no", None: "-"}, identity["order"]
    if not isinstance(order, str):
        order = "diverges" if order is None else f"{order:.2f}"
    return (
        identity["plant"], identity["integrator"], order, answers[identity["symplectic"]],
        answers[identity["reversible"]], identity["stable"],
    )  # fmt: skip


def _print_counts(asked: Sequence[Line], file: TextIO) -> None:
    """Expectations that hold of those that there are, by plant and integrator and section."""

    def count(section: str, owner: tuple[str, str] | None = None) -> str:
        own = [x for x in asked if x["section"] == section and owner in (None, owner_of(x))]
        return f"{sum(line['holds'] for line in own)}/{len(own)}" if own else ""

    def owner_of(line: Line) -> tuple[str, str]:
        return line["plant"], "" if line["integrator"] == ANY else line["integrator"]

    sections = list(dict.fromkeys(line["section"] for line in asked))
    plants = list(dict.fromkeys(line["plant"] for line in asked))
    owners = sorted(dict.fromkeys(map(owner_of, asked)), key=lambda owner: plants.index(owner[0]))
    print("\nExpectations that hold, of those there are", file=file)
    rows = [(*owner, *(count(section, owner) for section in sections)) for owner in owners]
    rows.append(("all", "", *map(count, sections)))
    print_columns(("plant", "integrator", *sections), rows, file)


def write_page(result: Mapping[str, Any], directory: Path) -> Path:
    """Write the page of a diagnosis beside the content that it shows.

    Args:
        result: content of ``diagnose.json``.
        directory: holds ``figures`` too.

    Raises:
        ModuleNotFoundError: if jinja2 is not installed, with the command that installs it.
    """
    lines = result["findings"]
    asked, failed = _split_judged(lines)
    counts = {noun: len(result[f"{noun}s"]) for noun in ("plant", "integrator")}
    counted = {**counts, "expectation": len(asked), "recorded rollout": result["records"]}
    tiles = [tuple(plural(count, noun).split(" ", 1)) for noun, count in counted.items()]
    tiles.insert(3, (f"{len(failed):,}", "do not hold" if len(failed) != 1 else "does not hold"))
    text: str = page_template(str(__package__), "diagnose.html.j2").render(
        **page_parts(),
        result=result,
        answer=_answer(result, asked, failed),
        tiles=tiles,
        identity=IDENTITY,
        identities=[_identity_cells(identity) for identity in result["identities"]],
        failed=list(_topics(failed)),
        figures=_figures(directory / "figures"),
        sections=[
            (*place, list(_topics(own)))
            for place, own in _group(lines, lambda x: (x["plant"], x["section"]))
        ],
        verdicts=VERDICTS,
        nothing=NOTHING,
        any_integrator=ANY,
        plural=plural,
    )
    return replace_file(directory / DIAGNOSIS_PAGE, text.encode())


def _answer(result: Mapping[str, Any], asked: Sequence[Line], failed: Sequence[Line]) -> str:
    answer = (
        f"{len(asked) - len(failed)} of {plural(len(asked), 'expectation')} of "
        f"{plural(len(result['integrators']), 'integrator')} on "
        f"{plural(len(result['plants']), 'plant')} hold."
    )
    if not failed:
        return answer
    counts = Counter(line["integrator"] for line in failed).most_common()
    by_name = ", ".join(f"{name} {count}" for name, count in counts)
    return f"{answer} What does not, by integrator: {by_name}."


def _figures(folder: Path) -> list[tuple[str, str, str]]:
    """Name, caption and picture of every figure."""
    found = []
    for name, caption in _CAPTIONS.items():
        for path in sorted(folder.glob(f"{name}*.png")):
            plant = path.stem.removeprefix(name).strip("_").replace("_", " ")
            content = base64.b64encode(path.read_bytes()).decode()
            title = f"{caption}, {plant}" if plant else caption
            found.append((path.stem, title, f"data:image/png;base64,{content}"))
    return found
