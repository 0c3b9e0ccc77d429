"""Optional packages: imported where they are used, named with the command that installs them."""

from __future__ import annotations

import importlib
import os
import platform
import re
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.machinery import PathFinder
from importlib.metadata import PackageNotFoundError, metadata, requires
from importlib.metadata import version as metadata_version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from .errors import InputError, MissingPackageError
from .isolated import ISOLATED

EXTRAS = {
    "evidence": ("pyarrow", "duckdb", "portalocker", "rich"),
    "fleet": ("jax", "pyarrow", "safetensors", "threadpoolctl", "rich"),
    "hub": ("huggingface_hub",),
    "render": ("pygame", "PIL", "imageio_ffmpeg"),
    "report": (
        "jinja2",
        "matplotlib",
        "msgspec",
        "safetensors",
        "scipy",
        "threadpoolctl",
        "rich",
    ),
    "storage": ("obstore", "fsspec"),
    "train": (
        "stable_baselines3",
        "torch",
        "tensorboard",
        "rich",
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
        raise missing_package(error.name if _is_installed(package) else package, extra) from None


def missing_package(package: str, *extras: str) -> MissingPackageError:
    """The error for a package that is not installed."""
    return MissingPackageError(
        f"{package} is not installed; run: {install_command(*extras)}", name=package
    )


def install_command(*extras: str) -> str:
    """What installs extras, or one environment of its own."""
    if len(extras) == 1 and extras[0] in ISOLATED:
        return ISOLATED[extras[0]].command
    wanted = ",".join(extras)
    return f'pip install -e ".[{wanted}]"' if checkout() else f'pip install "integ-gym[{wanted}]"'


@cache
def checkout() -> Path | None:
    """The checkout that this package is used from, into which extras are installed by its path."""
    folder = Path(__file__).resolve().parents[1]
    project = folder / "pyproject.toml"
    own = project.is_file() and 'name = "integ-gym"' in project.read_text(encoding="utf-8")
    return folder if own else None


def not_installed(modules: Iterable[str]) -> list[str]:
    """Those of some modules that are not installed."""
    return [module for module in modules if not _is_installed(module)]


def _is_installed(module: str) -> bool:
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
    lacking = {name: found for name in extras if (found := not_installed(EXTRAS[name]))}
    if lacking:
        first = sorted({found[0] for found in lacking.values()})
        raise missing_package(", ".join(first), *sorted(lacking))


@cache
def package_version(package: str) -> str | None:
    """Version of an installed distribution, None if there is none of that name."""
    try:
        return metadata_version(package)
    except PackageNotFoundError:
        return None


def running_version(package: str) -> str:
    """Version of a distribution in the environment that it runs in, ``unknown`` without one.

    That is its own, where it has one, and this one else.
    """
    found = ISOLATED[package].version() if package in ISOLATED else package_version(package)
    return found or "unknown"


def installed_versions(packages: Iterable[str]) -> dict[str, str]:
    """Version of Python, and of those packages that are installed."""
    found = {package: package_version(package) for package in packages}
    return {"python": platform.python_version(), **{k: v for k, v in found.items() if v}}


ANY_VERSION = "INTEG_GYM_ANY_VERSION"
"""Environment variable that names extras whose versions are chosen on purpose, and not checked."""

_REQUIREMENT = re.compile(
    r"(?P<package>[\w.-]+)(?:\[(?P<extras>[^]]*)\])?[^;]*?(?:>=(?P<least>[\d.]+))?[^;]*"
    r"(?:;(?P<condition>.*))?"
)
"""A line of a package's metadata about what it requires."""

_OF_EXTRA = re.compile(r"extra == .(?P<extra>[\w-]+)")


def check_versions(extra: str) -> None:
    """Check that no package of an extra is older than the extra asks for.

    Packages that are not installed are left to the modules that import them. An extra that is
    named in the environment variable ``INTEG_GYM_ANY_VERSION`` (several with commas, ``*`` for
    all) is not checked.

    Args:
        extra: its name; of a name that is no extra nothing is asked.

    Raises:
        ValueError: for an older one, with the command that installs a newer.
    """
    if {extra, "*"} & set(os.environ.get(ANY_VERSION, "").split(",")):
        return
    for package, least in required_by_extra(extra).items():
        found = package_version(package)
        if least and found is not None and _release(found) < _release(least):
            raise InputError(
                f"{package} {found} is installed, and integ-gym[{extra}] needs {least} or newer; "
                f'run: pip install "{package}>={least}", or set {ANY_VERSION}={extra} to try this '
                "one"
            )


@cache
def required_by_extra(extra: str | None, package: str = "integ-gym") -> Mapping[str, str]:
    """Packages that an extra asks for, those of extras in it included, with the oldest version.

    Args:
        extra: its name; None: what is needed without any.
        package: whose extra it is.

    Returns:
        Package to oldest version, which is empty where any serves.
    """
    try:
        lines = requires(package) or []
    except PackageNotFoundError:  # run from its sources
        return {}
    found: dict[str, str] = {}
    for asked in filter(None, map(_REQUIREMENT.fullmatch, lines)):
        condition = _OF_EXTRA.search(asked["condition"] or "")
        own = None if condition is None else condition["extra"].replace("-", "_")
        if own != (None if extra is None else extra.replace("-", "_")):
            continue
        if asked["package"] == package:
            for other in (asked["extras"] or "").split(","):
                found |= required_by_extra(other, package)
        else:
            found[asked["package"]] = asked["least"] or ""
    return found


@cache
def extra_names() -> frozenset[str]:
    """Names of this package's extras."""
    try:
        names = metadata("integ-gym").get_all("Provides-Extra") or []
    except PackageNotFoundError:  # run from its sources
        return frozenset()
    return frozenset(name.replace("-", "_") for name in names)


def _release(version: str) -> tuple[int, ...]:
    """The numbers that a version begins with, without zeros at the end: 4.0.0rc1 is 4."""
    numbers = [int(part) for part in re.findall(r"\d+", re.match(r"[\d.]*", version)[0])]  # type: ignore[index]
    while numbers and not numbers[-1]:
        numbers.pop()
    return tuple(numbers)
