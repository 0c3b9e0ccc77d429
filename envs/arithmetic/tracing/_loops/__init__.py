"""Loops over lanes that Numba compiles."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .lane_loop import LaneLoop
else:
    __getattr__, __dir__ = lazy_door(__name__)
