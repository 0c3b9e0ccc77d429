"""All figures of a panel, drawn from ``panel.json`` alone."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Final

from integ_gym.envs.extras import load
from integ_gym.eval.figure_style import png
from integ_gym.eval.figures.checks import draw_checks
from integ_gym.eval.figures.energy import draw_energy
from integ_gym.eval.figures.gaps import draw_gaps
from integ_gym.eval.figures.ladders import draw_ladders
from integ_gym.eval.figures.remedy import draw_remedy
from integ_gym.eval.figures.success import draw_success
from integ_gym.eval.panel_model import Panel
from integ_gym.evidence.atomic import replace_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FIGURES: Final[dict[str, Callable[[Panel], Figure | None]]] = {
    "success_matrix.png": draw_success,
    "transfer_gaps.png": draw_gaps,
    "energy_residual.png": draw_energy,
    "refinement_ladder.png": draw_ladders,
    "perturbations.png": draw_checks,
    "remedy.png": draw_remedy,
}


def write_figures(panel: Panel, directory: str | PathLike[str]) -> list[Path]:
    """Write a panel's figures as PNG files into a folder.

    A figure for which the panel has no numbers is not written, and one left there by an earlier
    run under the same name is removed.

    Parameters
    ----------
    panel
        What ``panel.json`` holds.
    directory
        The folder the files go to; made if it does not exist.

    Returns
    -------
    The files written, each complete as soon as it is there.

    Raises
    ------
    ModuleNotFoundError
        If matplotlib is not installed, with the command that installs it.
    """
    load("matplotlib", "report")
    folder = Path(directory)
    written = []
    for name, draw in _FIGURES.items():
        figure = draw(panel)
        path = folder / name
        if figure is None:
            path.unlink(missing_ok=True)
        else:
            written.append(replace_file(path, png(figure)))
    return written
