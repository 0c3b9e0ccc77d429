"""The figures of a panel, written as files: PNG for a page, PDF for print."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any, Final

from integ_gym.support.figures import FORMATS, write_figure
from integ_gym.support.optional import load

from ..panel.result import Panel
from .drawing import draw_forest, draw_ladders, draw_matrix
from .forests import (
    check_forest,
    gap_forest,
    paired_return,
    paired_success,
    remedy_forest,
)
from .ladders import ladder_plots, sweep_plots
from .matrices import energy_matrix, return_matrix, success_matrix
from .paper import print_forest, print_ladders, print_matrix

FIGURES: Final[dict[str, tuple[Any, Any]]] = {
    "success_matrix": (success_matrix, draw_matrix),
    "return_matrix": (return_matrix, draw_matrix),
    "transfer_gaps": (gap_forest, draw_forest),
    "paired_success": (paired_success, draw_forest),
    "paired_return": (paired_return, draw_forest),
    "energy_residual": (energy_matrix, draw_matrix),
    "refinement_ladder": (ladder_plots, draw_ladders),
    "sweeps": (sweep_plots, draw_ladders),
    "perturbations": (check_forest, draw_forest),
    "remedy": (remedy_forest, draw_forest),
}
"""Name of a figure to what describes it, as for the page, and what draws that."""


STYLES: Final = ("page", "paper")
"""How figures look: as on the page, or as papers print them."""


_PRINTED: Final[dict[Any, Any]] = {
    draw_matrix: print_matrix,
    draw_forest: print_forest,
    draw_ladders: print_ladders,
}
"""What draws a figure as on the page to what draws it for a paper."""


def write_figures(panel: Panel, directory: str | PathLike[str], style: str = "page") -> list[Path]:
    """Write a panel's figures as PNG, SVG and PDF files into a folder.

    A figure for which the panel has no numbers is not written, and one left there by an earlier
    run under the same name is removed.

    Parameters
    ----------
    panel
        What ``panel.json`` holds.
    directory
        The folder the files go to; made if it does not exist.
    style
        One of :data:`STYLES`.

    Returns
    -------
    The files written, each complete as soon as it is there.

    Raises
    ------
    ModuleNotFoundError
        If matplotlib is not installed, with the command that installs it.
    """
    load("matplotlib", "report")
    written: list[Path] = []
    for name, (describe, draw) in FIGURES.items():
        path, described = Path(directory) / name, describe(panel)
        if described is not None:
            drawn = draw if style == "page" else _PRINTED[draw]
            written += write_figure(drawn(described), path)
        else:
            for suffix in FORMATS:
                path.with_suffix(suffix).unlink(missing_ok=True)
    return written
