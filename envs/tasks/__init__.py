"""Tasks: what is asked of a plant, one module each, found by name.

A task gives starts, observations, rewards, termination and success; it knows no integrator, engine
or environment.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from integ_gym.support import Registry, lazy_door

if TYPE_CHECKING:
    from ._box import FLOAT32_ROUNDING, BoxTask
    from .cart_pole_balance import CartPoleBalance
    from .cart_pole_swing_up import CartPoleSwingUp
    from .elastic_pendulum_quiet import NEAR_PLUMB, ElasticPendulumQuiet
    from .interface import Command, Task
    from .pendulum_swing_up import NEAR_UPRIGHT, PendulumSwingUp, wrapped
else:
    __getattr__, __dir__ = lazy_door(__name__)


TASKS = Registry(__name__, "task", "reward")
