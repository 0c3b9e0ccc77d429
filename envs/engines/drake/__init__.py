"""Drake: the plant as a `MultibodyPlant`, and its integrators made to take steps of one size."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .engine import DrakeEngine
else:
    __getattr__, __dir__ = lazy_door(__name__)
