"""Versions of installed packages."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, requires
from importlib.metadata import version as metadata_version

from .apart.environments import APART


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
    found = APART[package].version() if package in APART else package_version(package)
    return found or "unknown"


def installed_versions(packages: Iterable[str]) -> dict[str, str]:
    """Version of Python, and of those packages that are installed."""
    found = {package: package_version(package) for package in packages}
    return {"python": platform.python_version(), **{k: v for k, v in found.items() if v}}


ANY_VERSION = "INTEG_GYM_ANY_VERSION"
"""Environment variable that names extras whose versions are chosen on purpose, and not checked."""

_REQUIREMENT = re.compile(
    r"(?P<package>[\w.-]+)(?:\[(?P<extras>[^]]*)\])?[^;]*?(?:>=(?P<least>[\d.]+))?[^;]*"
    r";.*extra == .(?P<extra>[\w-]+)"
)
"""A line of the metadata of this package about an extra."""


def check_versions(extra: str) -> None:
    """Check that no package of an extra is older than the extra asks for.

    Packages that are not installed are left to whoever imports them. An extra that is named in the
    environment variable ``INTEG_GYM_ANY_VERSION`` (several with commas) is not checked.

    Args:
        extra: its name; of a name that is no extra nothing is asked.

    Raises:
        ValueError: for an older one, with the command that installs a newer.
    """
    if extra in os.environ.get(ANY_VERSION, "").split(","):
        return
    for package, least in _least_versions(extra).items():
        found = package_version(package)
        if found is not None and _release(found) < _release(least):
            raise ValueError(
                f"{package} {found} is installed, and integ-gym[{extra}] needs {least} or newer; "
                f'run: pip install "{package}>={least}", or set {ANY_VERSION}={extra} to try this '
                "one"
            )


@cache
def _least_versions(extra: str) -> dict[str, str]:
    """Package to the oldest version that an extra takes, those of extras in it included."""
    try:
        lines = requires("integ-gym") or []
    except PackageNotFoundError:  # run from its sources
        return {}
    least: dict[str, str] = {}
    for asked in filter(None, map(_REQUIREMENT.match, lines)):
        if asked["extra"].replace("-", "_") != extra.replace("-", "_"):
            continue
        if asked["package"] == "integ-gym":
            for other in asked["extras"].split(","):
                least |= _least_versions(other)
        elif asked["least"]:
            least[asked["package"]] = asked["least"]
    return least


def _release(version: str) -> tuple[int, ...]:
    """The numbers that a version begins with, without zeros at the end: 4.0.0rc1 is 4."""
    numbers = [int(part) for part in re.findall(r"\d+", re.match(r"[\d.]*", version)[0])]  # type: ignore[index]
    while numbers and not numbers[-1]:
        numbers.pop()
    return tuple(numbers)
