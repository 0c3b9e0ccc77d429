"""Figures of a panel, one module each."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .write import STYLES, write_figures
else:
    __getattr__, __dir__ = lazy_door(__name__)
