"""Published environments called pendulum or cart-pole: one module for each library."""

from __future__ import annotations

from importlib.util import find_spec

from integ_gym.support import Registry

PUBLISHED = Registry(__name__, "published library", "subjects")


def installed(name: str) -> bool:
    """Whether the modules that a library needs are found; its name, or ``"module:Class"``."""
    return all(find_spec(module) is not None for module in PUBLISHED.load(name).modules)


__all__ = ["PUBLISHED", "installed"]
