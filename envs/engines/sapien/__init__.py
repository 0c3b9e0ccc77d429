"""SAPIEN: the plant as an articulation of NVIDIA's PhysX 5."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .engine import SapienEngine
else:
    __getattr__, __dir__ = lazy_door(__name__)
