"""Hand-made controllers: one module for each task, named as the task's, found in this folder.

Knows a task's plant and its parameters, not its discretization.
"""

from __future__ import annotations

from typing import Any

from integ_gym.support import Registry

from .interface import HandMade

HANDMADE = Registry(__name__, "hand-made controller", "act")


def controller_classes() -> list[type[HandMade[Any]]]:
    """Classes of all hand-made controllers, by the names of their modules."""
    return [HANDMADE.load(name) for name in HANDMADE.names()]


__all__ = ["HANDMADE", "controller_classes"]
