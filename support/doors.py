"""Doors of packages: public names, each imported when it is first asked for."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module, util
from typing import Any


def lazy_door(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """``__getattr__`` and ``__dir__`` of a package whose names are imported on demand.

    The names are those that its ``__init__`` imports under ``if TYPE_CHECKING:``, where type
    checkers and editors read them as well, so that they are written once. They and what the
    ``__init__`` defines itself are its ``__all__``. None may equal a module of the package, which
    Python would put in its place.

    Args:
        package: its ``__name__``.
    """

    @cache
    def tree() -> ast.Module:
        return ast.parse(_source(package))

    @cache
    def origins() -> dict[str, str]:
        guarded = [n for n in tree().body if isinstance(n, ast.If) and _is_guard(n.test)]
        imports = [n for block in guarded for n in block.body if isinstance(n, ast.ImportFrom)]
        return {a.name: "." * n.level + (n.module or "") for n in imports for a in n.names}

    def public() -> list[str]:
        own = [name for node in tree().body for name in _defined(node) if name[0] != "_"]
        return sorted({*origins(), *own})

    def find(name: str) -> Any:
        if name == "__all__":
            return public()
        if name not in origins():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home = origins()[name]
        if home == ".":
            return import_module(f".{name}", package)
        value = getattr(import_module(home, package), name)
        setattr(sys.modules[package], name, value)
        return value

    return find, public


def _source(package: str) -> str:
    spec = util.find_spec(package)
    source = spec and spec.loader and spec.loader.get_source(package)  # type: ignore[attr-defined]
    if source is None:
        raise ImportError(f"the source of {package} is not there, which its names are read from")
    return str(source)


def _is_guard(test: ast.expr) -> bool:
    return isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"


def _defined(node: ast.stmt) -> list[str]:
    """Names that a statement of a door defines, or takes from a module beside it at once."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    if isinstance(node, ast.ImportFrom) and node.level == 1:
        return [alias.name for alias in node.names]
    targets = node.targets if isinstance(node, ast.Assign) else []
    return [target.id for target in targets if isinstance(target, ast.Name)]
