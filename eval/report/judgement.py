"""The page of a judgement of results that others measured."""

from __future__ import annotations

from collections.abc import Iterator

from integ_gym.support.optional import package_version
from integ_gym.support.pages import page_parts
from integ_gym.support.terminal import fixed, plural

from .. import statistics as stats
from ..judge import STATUS_WORDS, Compared, Judgement, answer_of, limitations
from ..result_files import MEASURES
from ..verdict import p_text
from .forests import RATE_AXIS, Axis, Line, Mark, difference_axis, value_axis
from .page import report_environment


def render_judgement(found: Judgement, command: str) -> str:
    """The page of a judgement: one HTML file that opens offline.

    Raises:
        ModuleNotFoundError: if jinja2 is not installed, with the command that installs it.
    """
    page: str = report_environment().get_template("judge.html.j2").render(
        **page_parts(),
        answer=answer_of(found),
        forests=list(_forests(found)),
        limitations=limitations(found),
        command=command,
        version=package_version("integ-gym"),
    )  # fmt: skip
    return page


def _forests(found: Judgement) -> Iterator[tuple[str, Axis, list[Line]]]:
    """Title, axis and lines of each figure of the page."""
    for name in MEASURES:
        judged = [one for one in found.judged if name in one.estimates]
        values = [one.estimates[name] for one in judged]
        lines = [
            _line(one.policy, one.condition, value,
                  f"{plural(one.seeds, 'seed')}, {plural(one.episodes, 'episode')}")
            for one, value in zip(judged, values, strict=True)
        ]  # fmt: skip
        yield name.title(), RATE_AXIS if name == "success" else value_axis(values), lines
        axis = difference_axis if name == "success" else value_axis
        for title, group in (("Lost from home", found.losses), ("Policies", found.policies)):
            own = [one for one in group if one.measure == name]
            lines = [
                _line(one.place, f"{one.first} − {one.second}", one.difference, _note(one))
                for one in own
            ]
            yield f"{title}: {name}", axis([one.difference for one in own]), lines


def _note(one: Compared) -> str:
    split = {"difficulty": one.difficulty, "rest": one.rest}
    parts = [f"{name} {value}" for name, value in split.items() if value]
    return ", ".join([STATUS_WORDS[one.status], p_text(one.p_adjusted), *parts])


def _line(row: str, cell: str, value: stats.Estimate, note: str) -> Line:
    ends = " to ".join(map(fixed, value.ends)) if value.bounded else ""
    return Line(
        row, cell, (row, cell), (Mark(value, "accent"),), fixed(value.estimate), ends,
        f"{row}, {cell}: {value}", note,
    )  # fmt: skip
