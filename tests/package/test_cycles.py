"""Within a top-level folder no module imports itself, in however many steps."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
FOLDERS: dict[str, str] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))[
    "tool"
]["setuptools"]["package-dir"]
"""Import package to the folder that it is made of."""


def modules_in(folder: Path, package: str) -> dict[str, Path]:
    """Name of every module below a folder, with its file."""
    found = {}
    for path in sorted(folder.rglob("*.py")):
        inner = path.relative_to(folder).with_suffix("").parts
        found[".".join((package, *inner)).removesuffix(".__init__")] = path
    return found


def _statements(node: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
    """Imports at any depth, within functions too, but for those for type checkers alone."""
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        yield node
    typing = isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")
    for child in node.orelse if typing else ast.iter_child_nodes(node):  # type: ignore[attr-defined]
        yield from _statements(child)


def _named(statement: ast.Import | ast.ImportFrom, importer: str, is_door: bool) -> Iterator[str]:
    """Full names of what a statement may import, modules or not, the longest first."""
    if isinstance(statement, ast.Import):
        yield from (alias.name for alias in statement.names)
        return
    own = importer.split(".")
    upwards = own[: len(own) - statement.level + is_door] if statement.level else []
    base = ".".join([*upwards, *([statement.module] if statement.module else [])])
    yield from (f"{base}.{alias.name}" for alias in statement.names)


def imports_of(modules: Mapping[str, Path]) -> dict[str, set[str]]:
    """What of some modules each of them imports.

    Importing a module runs the doors of the packages that it lies in; those in which the importer
    does not lie itself count as imported.
    """
    graph: dict[str, set[str]] = {}
    for importer, path in modules.items():
        found = graph[importer] = set()
        for statement in _statements(ast.parse(path.read_text(encoding="utf-8"))):
            for name in _named(statement, importer, path.name == "__init__.py"):
                parts = name.split(".")
                prefixes = {".".join(parts[:n]) for n in range(1, len(parts) + 1)}
                known = prefixes & modules.keys()
                around = {m for m in known if importer.startswith(f"{m}.")}
                direct = max(known, key=len, default=importer)
                found |= (known - around) | {direct}
        found.discard(importer)
    return graph


def cycle_in(graph: Mapping[str, set[str]]) -> list[str]:
    """Modules that import one another in a circle, the first again at the end, or none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])[::-1]
    return []


def _expected(folder: str) -> list[pytest.MarkDecorator]:
    why = "the reference trainer's command imports the fleet, which imports the trainer"
    return [pytest.mark.xfail(reason=why, strict=True)] if folder == "train" else []


@pytest.mark.parametrize(
    ("package", "folder"),
    [pytest.param(*item, id=item[1], marks=_expected(item[1])) for item in FOLDERS.items()],
)
def test_no_module_imports_itself(package, folder):
    modules = modules_in(ROOT / folder, package)
    graph = imports_of(modules)
    assert len(modules) > 1
    assert sum(map(len, graph.values())) > 1
    assert not (cycle := cycle_in(graph)), " imports ".join(cycle)


@pytest.mark.parametrize(
    ("files", "circle"),
    [
        ({"a": "from p import b", "b": "import p.c", "c": "from p.a import x"}, "abc"),
        ({"a": "from . import b", "b": "def f():\n    from .a import x"}, "ab"),
        ({"a": "from .b import x", "b/__init__": "from .c import x", "b/c": "import p.a"}, None),
        ({"a": "from .b.c import x", "b/__init__": "from ..a import x", "b/c": ""}, "ab"),
        ({"a": "from .b.c import x", "b/__init__": "", "b/c": "from ..a import y"}, None),
        ({"a": "if TYPE_CHECKING:\n    import p.b", "b": "import p.a"}, ""),
        ({"a": "from .b import x", "b": "from .c.d import x", "c/d": "import p"}, ""),
    ],
)
def test_circles_are_seen(tmp_path, files, circle):
    for name, source in files.items():
        path = tmp_path / f"{name}.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(source, encoding="utf-8")
    cycle = cycle_in(imports_of(modules_in(tmp_path, "p")))
    if circle is None:
        assert cycle
    else:
        assert {name.removeprefix("p.") for name in cycle} == set(circle)
