"""Pinocchio: its forward dynamics under our integrators."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .engine import PinocchioEngine
else:
    __getattr__, __dir__ = lazy_door(__name__)
