"""Plants: continuous-time systems, one module each, found by name.

A plant gives accelerations, energy and losses; it knows no integrator and no task.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from integ_gym.support import Registry, lazy_door

if TYPE_CHECKING:
    from ._oscillator import Oscillator
    from .cart_pole import CartPole
    from .elastic_pendulum import ElasticPendulum
    from .interface import Plant, join_state, split_state, state_names, state_units
    from .pendulum import Pendulum
else:
    __getattr__, __dir__ = lazy_door(__name__)


PLANTS = Registry(__name__, "plant", "acceleration")
