"""One-step maps by name."""

from __future__ import annotations

from typing import Any

from ..registries import INTEGRATORS, MAPS, TRUTH


def one_step_map(name: str) -> Any:
    """The map or integrator of that name, an object with a ``step`` as integrators have it.

    Raises:
        ValueError: for an unknown name.
    """
    registry = INTEGRATORS if name in INTEGRATORS else MAPS
    return registry.load(name)()


def map_names() -> tuple[str, ...]:
    """Names of all maps that an engine is compared with, ours first; the exact solution is none."""
    return (*(n for n in INTEGRATORS.names() if n != TRUTH), *MAPS.names())
