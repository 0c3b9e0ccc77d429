"""Where things lie: the repository's root, the folders of the package, and blocks of its pages."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]

FLOORS = ("support", "envs", "evidence", "train", "eval", "package")
"""From the lowest; each may know those before it."""


def two(value: float) -> str:
    """A number with two decimals, as pages write it."""
    return f"{value:z.2f}".replace("-", "−")


def page_text(path: str) -> str:
    """A page by its path in the repository."""
    return (ROOT / path).read_text(encoding="utf-8")


def page_blocks(path: str, language: str) -> list[str]:
    """Code blocks of one language in a page."""
    return re.findall(rf"^```{language}\n(.*?)^```", page_text(path), re.DOTALL | re.MULTILINE)
