"""Versions of installed packages."""

from __future__ import annotations

import platform
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as metadata_version

from .apart import APART


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
