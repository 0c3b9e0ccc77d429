"""Figures of a diagnosis and of the worked example, drawn from their data alone."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .drift import WINDOW, draw_drift
    from .write import write_diagnosis_figures
else:
    __getattr__, __dir__ = lazy_door(__name__)
