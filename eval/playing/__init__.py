"""Playing: somebody drives a plant by hand and changes its discretization while it moves.

Knows environments and windows, no policies and no records.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .game import Game
    from .window import play_in_window
else:
    __getattr__, __dir__ = lazy_door(__name__)
