"""Imports run one way; the users' door, type checkers and registries agree with the files."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import pytest
from house import FLOORS, ROOT, page_blocks

import integ_gym
from integ_gym.envs import registries
from integ_gym.support.registry import Registry


def _imports(path: Path) -> Iterator[tuple[int, str]]:
    """Line and absolute module of what a file imports of this project, within functions too."""
    floor, *inner = path.relative_to(ROOT).with_suffix("").parts
    own = ["integ_gym", *([] if floor == "package" else [floor]), *inner]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            package = own[: len(own) - node.level] if node.level else []
            module = ".".join([*package, *([node.module] if node.module else [])])
            names = [f"{module}.{alias.name}" for alias in node.names]
        else:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        yield from ((node.lineno, name) for name in names if name.startswith("integ_gym."))


def _floor(module: str) -> str:
    second = module.split(".")[1]
    return second if second in FLOORS else "package"


@pytest.mark.parametrize("floor", FLOORS)
def test_imports_run_downwards(floor):
    files = sorted((ROOT / floor).rglob("*.py"))
    assert files
    for path in files:
        for line, module in _imports(path):
            assert FLOORS.index(_floor(module)) <= FLOORS.index(floor), f"{path}:{line}: {module}"


def _programs() -> Iterator[tuple[str, str]]:
    """Path and text of each Python program that is neither of the six roots nor a test."""
    for folder in ("benchmarks", "examples", ".ci"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        name = path.relative_to(ROOT).as_posix()
        for block in page_blocks(name, "python"):
            yield name, re.sub(r"^(>>>|\.\.\.) ?", "", block, flags=re.MULTILINE)


def _trees(text: str) -> Iterator[ast.Module]:
    """A program and those that it holds as strings, which other processes run."""
    tree = ast.parse(text)
    yield tree
    for node in ast.walk(tree):
        held = node.value if isinstance(node, ast.Constant) else None
        if isinstance(held, str) and "\n" in held and "import" in held and "integ_gym" in held:
            with suppress(SyntaxError):  # of a docstring
                yield ast.parse(held)


def _is_there(name: str) -> bool:
    module, _, attribute = name.rpartition(".")
    try:
        return hasattr(import_module(module), attribute) or bool(import_module(name))
    except ImportError:
        return False


def test_programs_import_names_that_exist():
    used = {}
    for path, text in _programs():
        for node in (node for tree in _trees(text) for node in ast.walk(tree)):
            if isinstance(node, ast.ImportFrom) and f"{node.module}".startswith("integ_gym"):
                used |= {f"{node.module}.{alias.name}": path for alias in node.names}
            elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "integ_gym":
                used[f"integ_gym.{node.attr}"] = path
    assert len(used) > 200
    assert not {path: name for name, path in used.items() if not _is_there(name)}


def test_type_checkers_are_told_what_the_users_door_offers():
    stub = ast.parse((ROOT / "package" / "__init__.pyi").read_text(encoding="utf-8"))
    told = {
        alias.name: f"{node.module}"
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert set(told) == set(integ_gym.__all__)
    assert set(dir(integ_gym)) == set(told)
    for name, module in told.items():
        value = getattr(integ_gym, name)
        assert value is getattr(sys.modules[module], name), name


REGISTRIES = {name: one for name, one in vars(registries).items() if isinstance(one, Registry)}
PARTS = [(kind, name) for kind, registry in REGISTRIES.items() for name in registry.parts]


@pytest.mark.parametrize(("kind", "name"), PARTS)
def test_every_registered_part_is_there(kind, name):
    assert REGISTRIES[kind].load(name).__doc__


ADDED = """
import gymnasium as gym, numpy as np, integ_gym
from integ_gym.envs.registries import INTEGRATORS
assert "their_euler" in INTEGRATORS.names()
env = gym.make("IntegPendulum-v0", integrator="their_euler", dt=0.05)
ours = gym.make("IntegPendulum-v0", integrator="explicit_euler", dt=0.05)
env.reset(seed=0), ours.reset(seed=0)
assert (env.step(np.ones(1))[0] == ours.step(np.ones(1))[0]).all()
assert len(INTEGRATORS.source_hash("their_euler")) == 64
assert INTEGRATORS.source_hash("explicit_euler") is None
"""


def test_an_installed_package_adds_its_parts_by_entry_points(tmp_path):
    (tmp_path / "theirs.py").write_text(
        "from integ_gym.envs.integrators.euler import ExplicitEuler\n"
        "class TheirEuler(ExplicitEuler):\n    '''The same.'''\n",
        encoding="utf-8",
    )
    metadata = tmp_path / "theirs-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "[integ_gym.integrators]\ntheir_euler = theirs:TheirEuler\n"
    )
    subprocess.run([sys.executable, "-c", ADDED], cwd=tmp_path, check=True)
