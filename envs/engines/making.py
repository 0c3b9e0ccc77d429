"""Engines made by name, and what they need to be installed."""

from __future__ import annotations

from typing import Any

from integ_gym.support.packages.apart.environments import APART
from integ_gym.support.packages.extras import absent
from integ_gym.support.packages.versions import check_versions

from ..registries import ENGINES
from .interface import Engine


def missing_modules(engine: str) -> list[str]:
    """Modules that an engine needs and that are not installed.

    Its extra brings them; of an engine that runs in an environment of its own, what sets that up.
    """
    if engine in APART:
        return [] if APART[engine].installed else [engine]
    return absent(getattr(ENGINES.load(engine), "modules", ()))


def make_engine(name: str, system: Any, integrator: str, dt: Any) -> Engine:
    """An engine for a system.

    Args:
        name: of the engine, or ``"module:Class"``.
        system: a `PlantSystem`.
        integrator: as the engine calls it.
        dt: integration step, s.

    Raises:
        ValueError: for an unknown engine or integrator, or a package of the engine that is older
            than its extra asks for; see :func:`~integ_gym.support.check_versions`.
    """
    kind = ENGINES.load(name)
    check_versions(name)
    engine: Engine = kind(system, integrator, dt)
    return engine


def integrators_of(engine: str) -> tuple[str, ...]:
    """The integrators of an engine, as it calls them; ours without the exact one."""
    return tuple(ENGINES.load(engine).maps)
