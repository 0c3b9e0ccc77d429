"""Testbeds: tasks that can be made in any discretization, ours and other libraries'.

What `train`, `panel` and `evaluate` know of a task. A testbed names its hand-made controller and
never imports it.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .gym_testbed import GymTestbed
    from .interface import Applied, Success, Testbed
    from .making import make_checked, make_training_environments, testbed_of
else:
    __getattr__, __dir__ = lazy_door(__name__)
