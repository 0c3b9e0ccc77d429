"""Pictures of an episode: in a window, or as arrays.

Knows the geometry of plants, not how they move.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .canvas import load_pygame
    from .cockpit import SHOWN, Choice, Cockpit, View
    from .course import Course
    from .panes import Moment, Pane, Panes
    from .renderer import Renderer
    from .screen import open_screen
else:
    __getattr__, __dir__ = lazy_door(__name__)
