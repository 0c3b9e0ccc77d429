"""Where things lie: the repository's root, and the folders that the package is made of."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]

FLOORS = ("support", "envs", "evidence", "train", "eval", "package")
"""From the lowest; each may know those before it."""
