"""The packages: every folder below the roots that pyproject.toml maps. All else is said there."""

import tomllib
from pathlib import Path

from setuptools import setup

HERE = Path(__file__).parent
TOOLS = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["tool"]


def packages() -> list[str]:
    """Dotted names of all folders that hold a file, whether modules or what these read."""
    found = set()
    for name, root in TOOLS["setuptools"]["package-dir"].items():
        for file in filter(Path.is_file, (HERE / root).rglob("*")):
            inside = file.parent.relative_to(HERE / root).parts
            if "__pycache__" not in inside:
                found.add(".".join([name, *inside]))
    return sorted(found)


setup(packages=packages())
