"""Optional packages: imported where used, named with the command that installs them."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from functools import cache
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from .apart.environments import APART

EXTRAS = {
    "evidence": ("pyarrow", "duckdb", "portalocker"),
    "fleet": ("jax", "pyarrow", "safetensors", "threadpoolctl", "tqdm"),
    "render": ("pygame", "PIL", "imageio_ffmpeg"),
    "report": (
        "jinja2",
        "matplotlib",
        "msgspec",
        "safetensors",
        "scipy",
        "threadpoolctl",
        "tqdm",
    ),
    "storage": ("obstore", "fsspec"),
    "train": (
        "stable_baselines3",
        "torch",
        "tensorboard",
        "tqdm",
        "scipy",
        "threadpoolctl",
        "safetensors",
    ),
}
"""Extra to the modules that its users need; those of an engine stand in its class."""


def load(module: str, extra: str) -> Any:
    """Import a module that an extra brings.

    Raises:
        ModuleNotFoundError: if its package is not installed, in one line with the command that
            installs it.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise
        package = error.name.partition(".")[0]
        raise missing(error.name if _imports(package) else package, extra) from None


def _imports(package: str) -> bool:
    """Whether a package can be imported; what is missing is then a module of it."""
    try:
        importlib.import_module(package)
    except ModuleNotFoundError:
        return False
    return True


def missing(package: str, *extras: str) -> ModuleNotFoundError:
    """The error for a package that is not installed."""
    return ModuleNotFoundError(
        f"{package} is not installed; run: {install_command(*extras)}", name=package
    )


def install_command(*extras: str) -> str:
    """What installs extras, or one environment of its own."""
    if len(extras) == 1 and extras[0] in APART:
        return APART[extras[0]].command
    wanted = ",".join(extras)
    return (
        f'pip install -e ".[{wanted}]"' if _in_checkout() else f'pip install "integ-gym[{wanted}]"'
    )


@cache
def _in_checkout() -> bool:
    """Whether this package is used from a checkout, into which extras are installed by its path."""
    project = Path(__file__).resolve().parents[2] / "pyproject.toml"
    return project.is_file() and 'name = "integ-gym"' in project.read_text(encoding="utf-8")


def absent(modules: Iterable[str]) -> list[str]:
    """Those of some modules that are not installed."""
    return [module for module in modules if not _installed(module)]


def _installed(module: str) -> bool:
    """Whether there is a module; unlike `find_spec`, imports none that it lies in."""
    top, *inner = module.split(".")
    spec = find_spec(top)
    for name in inner:
        spec = spec and PathFinder.find_spec(name, spec.submodule_search_locations)
    return spec is not None


def require(*extras: str) -> None:
    """Check, without importing them, that the modules of some extras are installed.

    Raises:
        ModuleNotFoundError: in one line, with the command that installs what is missing.
    """
    lacking = {name: found for name in extras if (found := absent(EXTRAS[name]))}
    if lacking:
        first = sorted({found[0] for found in lacking.values()})
        raise missing(", ".join(first), *sorted(lacking))
