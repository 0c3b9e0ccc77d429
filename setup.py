"""The packages: every folder below the roots that pyproject.toml maps. All else is said there."""

import tomllib
from pathlib import Path

from setuptools import setup

HERE = Path(__file__).parent
TOOLS = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["tool"]


def packages() -> list[str]:
    """Dotted names of all folders with an ``__init__.py``."""
    found = []
    for name, root in TOOLS["setuptools"]["package-dir"].items():
        for door in (HERE / root).rglob("__init__.py"):
            found.append(".".join([name, *door.parent.relative_to(HERE / root).parts]))
    return sorted(found)


setup(packages=packages())
