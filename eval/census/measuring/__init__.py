"""What a subject of the census is found to do: its map, its drift, its speed limit."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .line import Line, measure
else:
    __getattr__, __dir__ = lazy_door(__name__)
