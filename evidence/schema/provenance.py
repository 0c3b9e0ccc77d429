"""Where and with which packages a record was made."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from functools import cache

from integ_gym.support import installed_versions

_PACKAGES = ("integ-gym", "gymnasium", "numpy")


def package_versions(further: Mapping[str, str]) -> dict[str, str]:
    """Versions of Python, of what integ-gym always needs, and of ``further`` packages."""
    return {**installed_versions(_PACKAGES), **further}


@cache
def host() -> str:
    """Operating system and processor."""
    return f"{platform.platform()} {platform.machine()}"
