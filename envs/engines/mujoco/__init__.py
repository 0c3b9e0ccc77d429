"""MuJoCo, called through its Python bindings."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .engine import MujocoEngine
    from .quiet import silencer
else:
    __getattr__, __dir__ = lazy_door(__name__)
