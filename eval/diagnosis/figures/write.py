"""Figures of a diagnosis, drawn from ``diagnose.json`` alone."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from integ_gym.support.figures import SeriesStyles, write_figure
from integ_gym.support.optional import load

from .contact import draw_contact
from .curves import draw_convergence, draw_stability, draw_work
from .drawing import Curve, plants_of, schemes_of
from .motion import draw_energy, draw_phase

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_diagnosis_figures(result: Mapping[str, Any], directory: Path) -> list[Path]:
    """Write a diagnosis's figures as PNG, SVG and PDF files into a folder.

    Args:
        result: content of ``diagnose.json``.
        directory: made if it does not exist.

    Returns:
        The files written.

    Raises:
        ModuleNotFoundError: without matplotlib, with the command that installs it.
    """
    load("matplotlib", "report")
    written: list[Path] = []
    schemes = schemes_of(result["integrators"])
    for name, (key, draw) in FIGURES.items():
        found = result["curves"].get(key)
        if found:
            written += write_figure(draw(found, schemes), directory / name)
    impacts = result["curves"].get("contact", [])
    for plant in plants_of(impacts):
        own = [c for c in impacts if c["plant"] == plant]
        name = f"contact_{re.sub(r'[^A-Za-z0-9._]+', '-', plant)}"
        written += write_figure(draw_contact(own, schemes), directory / name)
    return written


FIGURES: Final[dict[str, tuple[str, Callable[[Sequence[Curve], SeriesStyles], Figure]]]] = {
    "energy": ("free_motion", draw_energy),
    "phase_portraits": ("free_motion", draw_phase),
    "stability": ("stiffness", draw_stability),
    "convergence": ("refinement", draw_convergence),
    "work_precision": ("refinement", draw_work),
}
