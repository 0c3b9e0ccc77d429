"""CasADi: the plant's equations as its expressions, and its integrators as functions of floats."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .engine import CasadiEngine
else:
    __getattr__, __dir__ = lazy_door(__name__)
