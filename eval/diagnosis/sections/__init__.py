"""The sections of a diagnosis, one module each."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from . import (
        actuation,
        contact,
        damping,
        free_motion,
        friction,
        identity,
        latency,
        plant,
        refinement,
        stiffness,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
