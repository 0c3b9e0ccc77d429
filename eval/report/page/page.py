"""The report's page, written from ``panel.json`` alone."""

from __future__ import annotations

import json
from datetime import UTC
from functools import cache
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from integ_gym.support import VIRIDIS, page_environment, page_parts, plural, replace_file

from ... import verdict as rules
from ...panel.model import Panel
from ..data import (
    RATE_AXIS,
    check_forest,
    costs_of,
    energy_matrix,
    findings_of,
    gap_forest,
    ladder_plots,
    mixtures_of,
    ordered_verdicts,
    return_matrix,
    success_matrix,
    trust_of,
)
from . import drawing
from .failures import LABEL_WORDS, failure_table, failures_of
from .judged import card_of, comparison_of, tally_of
from .method import limits_of, settings_of
from .records import records_of
from .tiles import tiles_of

FILE_NAME: Final = "report.html"
"""Name of the report in a panel's directory."""

SHOWN_FINDINGS: Final = 7
"""Conclusions that are shown at once; the others are one click away."""


def write_report(panel: Panel, directory: str | PathLike[str]) -> Path:
    """Write ``report.html`` into a panel's directory.

    Parameters
    ----------
    panel
        What ``panel.json`` holds.
    directory
        The panel's directory; made if it does not exist.

    Returns
    -------
    Path of the file, which is complete as soon as it is there.

    Raises
    ------
    ModuleNotFoundError
        If jinja2 is not installed, with the command that installs it.
    """
    return replace_file(Path(directory) / FILE_NAME, render(panel).encode())


def render(panel: Panel) -> str:
    """The report's HTML.

    Raises
    ------
    ModuleNotFoundError
        As `write_report`.
    """
    text: str = _template().render(_context(panel))
    return text


@cache
def _template() -> Any:
    environment = page_environment()
    environment.filters.update(
        href=_href,
        percent=drawing.percent,
        across=drawing.across,
        up=drawing.up,
        corners=drawing.corners,
        shading=drawing.shading,
    )
    source = resources.files(__package__).joinpath("report.html.j2").read_text("utf-8")
    return environment.from_string(source)


def _context(panel: Panel) -> dict[str, Any]:
    trusts = trust_of(panel)
    cards = [card_of(judged) for judged in ordered_verdicts(panel)]
    return {
        **page_parts(),
        "panel": panel,
        "created": f"{panel.created.astimezone(UTC):%Y-%m-%d %H:%M} UTC",
        "tiles": tiles_of(panel, trusts),
        "success": success_matrix(panel),
        "returns": return_matrix(panel),
        "energy": energy_matrix(panel),
        "cards": cards,
        "tally": tally_of(cards),
        "gaps": gap_forest(panel),
        "remedies": mixtures_of(panel),
        "engine_lines": sorted(
            panel.engine_agreement, key=lambda one: (one.map, one.engine, -one.dt)
        ),
        "costs": costs_of(panel),
        "rate_axis": RATE_AXIS,
        "ladders": ladder_plots(panel),
        "checks": check_forest(panel),
        "frame": drawing,
        "trust": trusts,
        "findings": findings_of(panel, trusts),
        "failure_table": failure_table(panel),
        "failures": failures_of(panel),
        "comparisons": [comparison_of(one) for one in panel.policy_comparisons],
        "records": records_of(panel),
        "limits": limits_of(panel),
        "settings": settings_of(panel),
        "spec_json": json.dumps(panel.spec, indent=2, ensure_ascii=False),
        "rules": rules,
        "pass_line": rules.PASS,
        "label_words": LABEL_WORDS,
        "shown_findings": SHOWN_FINDINGS,
        "ramp": ", ".join(f"#{stop}" for stop in VIRIDIS),
        "plural": plural,
    }


def _href(path: str) -> str:
    """A link to a file of the panel, always relative to the report."""
    return "./" + quote(path.replace("\\", "/").lstrip("/"), safe="/=")
