"""The house as its files show it: floors, rooms, modules, and what each module imports."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
FOLDERS: dict[str, str] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))[
    "tool"
]["setuptools"]["package-dir"]
"""Import package to the folder that it is made of."""

FLOORS = ("support", "envs", "evidence", "train", "eval", "package")
"""From the lowest; each may know those before it."""


@dataclass(frozen=True)
class Import:
    """One imported name.

    Attributes:
        module: absolute, without the name.
        name: what is imported from it; empty for ``import module``.
        level: dots of a relative import.
        line: where.
    """

    module: str
    name: str
    level: int
    line: int


@dataclass(frozen=True)
class Source:
    """A module and its file."""

    name: str
    path: Path

    @property
    def is_door(self) -> bool:
        """Whether it is the door of a folder."""
        return self.path.name == "__init__.py"

    @cached_property
    def tree(self) -> ast.Module:
        """Its syntax."""
        return ast.parse(self.path.read_text(encoding="utf-8"))

    @property
    def floor(self) -> str:
        """Its top-level folder."""
        return floor_of(self.name)

    @property
    def package(self) -> str:
        """The package that it lies in, which is itself for a door."""
        return self.name if self.is_door else self.name.rpartition(".")[0]

    def imports(self, within: str = "runtime") -> list[Import]:
        """What it imports of this project.

        Args:
            within: ``runtime``: everything but what only type checkers see and what only a script
                does that is run by its path; ``door``: what only type checkers see.
        """
        nodes = _statements(self.tree, within == "door")
        return [found for node in nodes for found in self._named(node)]

    def _named(self, node: ast.Import | ast.ImportFrom) -> Iterator[Import]:
        if isinstance(node, ast.Import):
            yield from (Import(alias.name, "", 0, node.lineno) for alias in node.names)
            return
        own = self.package.split(".")
        upwards = own[: len(own) - node.level + 1] if node.level else []
        module = ".".join([*upwards, *([node.module] if node.module else [])])
        yield from (Import(module, alias.name, node.level, node.lineno) for alias in node.names)


def floor_of(module: str) -> str:
    """Top-level folder of a module of this project; the empty text for any other."""
    first, _, rest = module.partition(".")
    if first != "integ_gym":
        return ""
    second = rest.partition(".")[0]
    return second if second in FLOORS else "package"


def modules_in(folder: Path, package: str) -> dict[str, Source]:
    """Every module below a folder, by name."""
    found = {}
    for path in sorted(folder.rglob("*.py")):
        inner = path.relative_to(folder).with_suffix("").parts
        name = ".".join((package, *inner)).removesuffix(".__init__")
        found[name] = Source(name, path)
    return found


def all_modules() -> dict[str, Source]:
    """Every module of the project, by name."""
    return {n: s for p, f in FOLDERS.items() for n, s in modules_in(ROOT / f, p).items()}


def origin(modules: Mapping[str, Source], module: str, name: str) -> str:
    """The module that a name imported from another is defined in, through however many doors."""
    if f"{module}.{name}" in modules:
        return f"{module}.{name}"
    source = modules.get(module)
    if source is None or not source.is_door:
        return module
    for offered in source.imports("door"):
        if offered.name == name:
            return origin(modules, offered.module, name)
    return module


def imports_of(modules: Mapping[str, Source]) -> dict[str, set[str]]:
    """What of some modules each of them runs when it is imported, doors looked through."""
    graph: dict[str, set[str]] = {}
    for importer, source in modules.items():
        found = graph[importer] = set()
        for one in source.imports():
            target = origin(modules, one.module, one.name) if one.name else one.module
            parts = target.split(".")
            prefixes = {".".join(parts[:n]) for n in range(1, len(parts) + 1)} & modules.keys()
            around = {m for m in prefixes if importer.startswith(f"{m}.")}
            found |= (prefixes - around) | ({target} & modules.keys())
        found.discard(importer)
    return graph


def _statements(node: ast.AST, for_checkers: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """Imports at any depth, within functions too."""
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        if not for_checkers:
            yield node
        return
    test = ast.unparse(node.test) if isinstance(node, ast.If) else ""
    if isinstance(node, ast.If) and test.endswith("TYPE_CHECKING"):
        if for_checkers:
            yield from (n for n in node.body if isinstance(n, (ast.Import, ast.ImportFrom)))
        children = iter(node.orelse)
    elif isinstance(node, ast.If) and test == "__name__ == '__main__'":
        children = iter(node.orelse)
    else:
        children = ast.iter_child_nodes(node)
    for child in children:
        yield from _statements(child, for_checkers)
