"""Which code made a summary."""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

ROOMS = ("support", "envs", "evidence", "train", "eval")
"""What can change a result."""

LEFT_OUT = ("atlas", "report", "film", "playing", "census", "diagnosis", "__pycache__")
"""Rooms that read results and make none."""


@cache
def code_version() -> str:
    """SHA-256 over the code that decides results, 16 hexadecimal digits; docstrings left out."""
    digest = hashlib.sha256()
    for room in ROOMS:
        for name, source in sorted(_sources(resources.files(f"integ_gym.{room}"), room)):
            digest.update(name.encode())
            digest.update(_bare(source).encode())
    return digest.hexdigest()[:16]


def _sources(folder: Traversable, name: str) -> list[tuple[str, str]]:
    found = []
    for entry in folder.iterdir():
        own = f"{name}/{entry.name}"
        if entry.is_dir() and entry.name not in LEFT_OUT:
            found += _sources(entry, own)
        elif entry.name.endswith(".py"):
            found.append((own, entry.read_text(encoding="utf-8")))
    return found


def _bare(source: str) -> str:
    """A module's syntax tree without its docstrings and other idle texts."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        for body in _bodies(node):
            body[:] = [one for one in body if not _is_text(one)] or [ast.Pass()]
    return ast.dump(tree)


def _bodies(node: ast.AST) -> list[list[Any]]:
    return [node.body] if isinstance(getattr(node, "body", None), list) else []  # type: ignore[attr-defined]


def _is_text(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
