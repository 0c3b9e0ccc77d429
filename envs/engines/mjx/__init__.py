"""MJX: MuJoCo in JAX, its step a compiled function of numbers."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .engine import MjxEngine
else:
    __getattr__, __dir__ = lazy_door(__name__)
