"""Isaac Lab: a plant as an articulation of a scene, in a process of Isaac Lab's own environment."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .engine import IsaaclabEngine
else:
    __getattr__, __dir__ = lazy_door(__name__)
