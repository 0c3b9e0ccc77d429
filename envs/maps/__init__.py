"""One-step maps that engines apply beside our own integrators: one module each, found by name.

They are written as integrators are, and are no choice for `integrator`: an engine's name for one of
them belongs to the engine.
"""

from __future__ import annotations

from typing import Any

from integ_gym.support import Registry

from ..integrators import INTEGRATORS, TRUTH

MAPS = Registry(__name__, "one-step map", "step")


def one_step_map(name: str) -> Any:
    """The map or integrator of that name, an object with a ``step`` as integrators have it.

    Raises:
        ValueError: for an unknown name.
    """
    registry = INTEGRATORS if name in INTEGRATORS.names() else MAPS
    return registry.load(name)()


def map_names() -> tuple[str, ...]:
    """Names of all maps that an engine is compared with, ours first; the exact solution is none."""
    return (*(n for n in INTEGRATORS.names() if n != TRUTH), *MAPS.names())


__all__ = ["MAPS", "map_names", "one_step_map"]
