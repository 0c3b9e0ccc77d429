"""Published environments called pendulum or cart-pole: one module for each library."""

from __future__ import annotations

from importlib.util import find_spec

from integ_gym.support import Registry

PUBLISHED = Registry(__name__, "published library", "subjects")


def installed(name: str) -> bool:
    """Whether the modules that a library needs are found, and the environment of its own.

    Args:
        name: registered, or ``"module:Class"``.
    """
    library = PUBLISHED.load(name)
    apart = getattr(library, "apart", None)
    found = all(find_spec(module) is not None for module in library.modules)
    return found and (apart is None or bool(apart.installed))


__all__ = ["PUBLISHED", "installed"]
