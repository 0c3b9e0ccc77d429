"""A diagnosis as text: what everybody is, what does not hold, and every line on request."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TextIO

from integ_gym.support.terminal import (
    hanging_indent,
    print_columns,
    print_wrapped,
    width_of,
)

from .lines import ANY, NOTHING, VERDICTS

_NAME = 17
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
    _print_identities(result["identities"], file)
    _print_failures(lines, file)
    if every_line:
        _print_lines(lines, file)
        _print_counts(lines, file)


def _print_lines(lines: Sequence[Line], file: TextIO) -> None:
    """One table for every quantity."""
    for title, topic in topics(lines):
        print(file=file)
        print_wrapped(title, file)
        rows = [
            (line["integrator"], line["shown"], line["expected"], line["tolerance"],
             VERDICTS[line["holds"]])
            for line in topic
        ]  # fmt: skip
        print_columns(("integrator", "measured", "expected", "tolerance", "holds"), rows, file)


def topics(lines: Sequence[Line]) -> Iterable[tuple[str, list[Line]]]:
    """Lines on one quantity together, with a title."""
    together: dict[tuple[str, ...], list[Line]] = {}
    for line in lines:
        key = (line["plant"], line["section"], line["quantity"])
        together.setdefault(key, []).append(line)
    for (plant, section, quantity), topic in together.items():
        steps = max((line["steps"] for line in topic), key=len)
        at = f" (dt {', '.join(f'{step:.4g}' for step in steps)} s)" if steps else ""
        yield f"{plant}, {section}: {quantity}{at}", topic


def _print_identities(identities: Sequence[Mapping[str, Any]], file: TextIO) -> None:
    """What every integrator was measured to be."""
    print("What they are", file=file)
    print_columns(IDENTITY, [identity_cells(told) for told in identities], file)


IDENTITY = (
    "plant", "integrator", "order", "symplectic", "reversible", "oscillations stable up to"
)  # fmt: skip
"""Names of what is told of an integrator on a plant."""


def identity_cells(told: Mapping[str, Any]) -> tuple[str, ...]:
    """What is told of an integrator on a plant, in words."""
    answers = {True: "yes", False: "no"}
    return (
        told["plant"], told["integrator"], _order(told["order"]),
        answers[told["symplectic"]], answers[told["reversible"]], told["stable"],
    )  # fmt: skip


def _order(order: float | str | None) -> str:
    if isinstance(order, float):
        return f"{order:.2f}"
    return "diverges" if order is None else order


def _print_counts(lines: Sequence[Line], file: TextIO) -> None:
    """Expectations that hold of those that there are, by plant and integrator and section."""
    asked = [line for line in lines if line["holds"] is not None]
    sections = list(dict.fromkeys(line["section"] for line in asked))
    plants = list(dict.fromkeys(line["plant"] for line in asked))
    owners = sorted(dict.fromkeys(map(_owner, asked)), key=lambda owner: plants.index(owner[0]))
    print("\nExpectations that hold, of those there are", file=file)
    rows = [(*owner, *(_count(asked, section, owner) for section in sections)) for owner in owners]
    rows.append(("all", "", *(_count(asked, section) for section in sections)))
    print_columns(("plant", "integrator", *sections), rows, file)


def _owner(line: Line) -> tuple[str, str]:
    return line["plant"], "" if line["integrator"] == ANY else line["integrator"]


def _count(asked: Sequence[Line], section: str, owner: tuple[str, str] | None = None) -> str:
    """Those that hold of a section's, and of one plant and integrator or of all."""
    own = [x for x in asked if x["section"] == section and owner in (None, _owner(x))]
    return f"{sum(line['holds'] for line in own)}/{len(own)}" if own else ""


def _print_failures(lines: Sequence[Line], file: TextIO) -> None:
    asked = [line for line in lines if line["holds"] is not None]
    failed = [line for line in asked if not line["holds"]]
    print(f"\n{len(asked) - len(failed)} of {len(asked)} expectations hold.", file=file)
    if not failed:
        return
    print_wrapped("These do not hold for an integrator at this step on this plant:", file)
    for title, topic in topics(failed):
        print(file=file)
        print_wrapped(title, file)
        for wanted, own in _by_expectation(topic):
            print_wrapped(f"expected {wanted}", file, indent="  ")
            for line in own:
                print(
                    hanging_indent(
                        f"    {line['integrator']:<{_NAME}} ", line["shown"], width_of(file)
                    ),
                    file=file,
                )


def _by_expectation(topic: Sequence[Line]) -> Iterable[tuple[str, list[Line]]]:
    """Lines of whom the same is expected together, with what that is."""
    together: dict[str, list[Line]] = {}
    for line in topic:
        wanted = line["expected"] + (
            f"; {line['tolerance']}" if line["tolerance"] != NOTHING else ""
        )
        together.setdefault(wanted, []).append(line)
    return together.items()
