"""Engines as cells of a panel: which are installed, what they apply, and their versions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from integ_gym.envs.engines.maps import map_names
from integ_gym.envs.engines.stepping import missing_modules
from integ_gym.envs.registries import ENGINES
from integ_gym.envs.settings import NATIVE, Discretization
from integ_gym.support.isolated import APART
from integ_gym.support.optional import install_command, running_version

from ..values import SpecError, check_known, many

INSTALLED = "installed"
"""In place of an engine's name: every installed one but the native."""

_EASIEST = "mujoco"
"""Of the engines that could be installed, where it serves."""


def check_some_installed(grid: Iterable[Discretization], maps: Sequence[str]) -> None:
    """Refuse a panel that is about engines where it has none but the native one.

    Args:
        grid: its discretizations.
        maps: names of the one-step maps that it asks of installed engines.

    Raises:
        SpecError: with the command that installs one.
    """
    if any(discretization.engine != NATIVE for discretization in grid):
        return
    serving = [
        name for name in absent_engines() if name not in APART and integrator_applying(name, maps)
    ]
    name = min(serving or [_EASIEST], key=lambda name: name != _EASIEST)
    raise SpecError(
        "it is about other engines, and none that it could use is installed; run: "
        f"{install_command(name)}, or see `integ-gym engines` for the others"
    )


def foreign_engines() -> tuple[str, ...]:
    """Names of all engines but the native one, installed or not."""
    return tuple(name for name in ENGINES.names() if name != NATIVE)


def absent_engines() -> tuple[str, ...]:
    """Names of the engines whose extra is not installed."""
    return tuple(name for name in foreign_engines() if missing_modules(name))


def installed_engines() -> tuple[str, ...]:
    """Names of the installed engines, without the native one."""
    return tuple(name for name in foreign_engines() if not missing_modules(name))


def integrator_applying(engine: str, maps: Sequence[str]) -> str | None:
    """An engine's own name for the first of some one-step maps that it applies.

    Args:
        engine: registered name, not the native one.
        maps: names of one-step maps, the preferred one first.

    Returns:
        The first such integrator in the engine's order, or None if it applies none of the maps.
    """
    own = ENGINES.load(engine).maps
    return next((name for wanted in maps for name in own if own[name] == wanted), None)


def map_of(discretization: Discretization) -> str:
    """The one-step map that a discretization applies."""
    maps = ENGINES.load(discretization.engine).maps
    return str(maps.get(discretization.integrator, discretization.integrator))


def is_engine(name: str) -> bool:
    """Whether a name is of an engine of ours or a user's; a testbed's own is its package."""
    return ":" in name or name in ENGINES


def engine_versions(engines: Iterable[str]) -> dict[str, str]:
    """Distribution and version behind each engine, this package itself left out."""
    packages = {ENGINES.load(n).package if is_engine(n) else n for n in engines} - {"integ-gym"}
    return {package: running_version(package) for package in sorted(packages)}


def on_installed(entry: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A table of ``engine = "installed"`` and ``map`` as one table per installed engine.

    Args:
        entry: with ``map``, one name or several, the preferred one first, and ``dt``.

    Returns:
        Tables of ``engine``, ``integrator`` and ``dt``; engines that apply none of the maps are
        left out.

    Raises:
        ValueError: for an integrator, which engines call differently, and for unknown maps.
    """
    if "integrator" in entry or "map" not in entry:
        raise ValueError(
            f'engine "{INSTALLED}" takes `map` in place of `integrator`, for engines call their '
            f"integrators differently; known maps: {', '.join(map_names())}"
        )
    maps = many(entry["map"])
    for name in maps:
        check_known("map in `evaluate`", str(name), map_names())
    chosen = {engine: integrator_applying(engine, maps) for engine in installed_engines()}
    others = {key: value for key, value in entry.items() if key not in ("engine", "map")}
    return [
        {"engine": engine, "integrator": integrator, **others}
        for engine, integrator in chosen.items()
        if integrator is not None
    ]
