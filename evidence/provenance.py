"""Where and with which packages a record was made."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version

_PACKAGES = ("integ-gym", "gymnasium", "numpy")


@cache
def _installed(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def package_versions(further: Mapping[str, str]) -> dict[str, str]:
    """Versions of Python, of what integ-gym always needs, and of ``further`` packages."""
    own = {package: _installed(package) for package in _PACKAGES}
    return {"python": platform.python_version(), **own, **further}


@cache
def host() -> str:
    """Operating system and processor."""
    return f"{platform.platform()} {platform.machine()}"
