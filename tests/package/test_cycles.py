"""Within a top-level folder no module imports itself, in however many steps."""

from __future__ import annotations

from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter

import pytest
from house import FOLDERS, ROOT, imports_of, modules_in


def cycle_in(graph: Mapping[str, set[str]]) -> list[str]:
    """Modules that import one another in a circle, the first again at the end, or none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])[::-1]
    return []


@pytest.mark.parametrize(("package", "folder"), FOLDERS.items(), ids=FOLDERS.values())
def test_no_module_imports_itself(package, folder):
    modules = modules_in(ROOT / folder, package)
    graph = imports_of(modules)
    assert len(modules) > 1
    assert folder == "package" or sum(map(len, graph.values())) > 1
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
        (
            {
                "a": "from .b import x",
                "b/__init__": "if TYPE_CHECKING:\n    from .c import x",
                "b/c": "from ..a import y",
            },
            None,
        ),
        ({"a": "if __name__ == '__main__':\n    import p.b", "b": "import p.a"}, ""),
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
