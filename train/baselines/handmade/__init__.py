"""Hand-made controllers: one module for each task, named as the task's, found in this folder.

Knows a task's plant and its parameters, not its discretization.
"""

from integ_gym.support import Registry

HANDMADE = Registry(__name__, "hand-made controller", "act")

__all__ = ["HANDMADE"]
