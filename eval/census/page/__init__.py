"""The census as people read it: the page, and its words."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .page import render_census
    from .words import row
else:
    __getattr__, __dir__ = lazy_door(__name__)
