"""Doors: every folder has one, top-level folders reach one another through them alone."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from types import ModuleType

import pytest
from house import FLOORS, FOLDERS, ROOT, all_modules, floor_of

import integ_gym

MODULES = all_modules()
DOORS = [source for source in MODULES.values() if source.is_door]
MOST_ENTRIES = 15
"""In a folder that is a registry: each engine is one of its entries."""


def _id(source) -> str:
    return str(source.path.relative_to(ROOT))


def test_the_house_is_found():
    """What the other tests run over is all there is, and is not nothing."""
    assert set(FOLDERS.values()) == set(FLOORS)
    assert len(MODULES) > 300
    assert len(DOORS) > 50
    assert {source.floor for source in MODULES.values()} == set(FLOORS)


@pytest.mark.parametrize("source", MODULES.values(), ids=_id)
def test_floors_are_crossed_through_doors_and_downwards(source):
    own = FLOORS.index(source.floor)
    by_path = source.path in (ROOT / "train" / "ppo.py", ROOT / "train" / "sac.py")
    for one in source.imports():
        floor = floor_of(one.module)
        if not floor:
            continue
        where = f"{_id(source)}:{one.line}: from {one.module} import {one.name}"
        if floor == source.floor:
            assert one.level or by_path, f"{where}: within a floor, imports are relative"
        else:
            assert not one.level, f"{where}: from another floor, imports are absolute"
            assert FLOORS.index(floor) < own, f"{where}: imports run downwards"
            assert one.module == f"integ_gym.{floor}", f"{where}: not through the door"
            offered = importlib.import_module(one.module).__all__
            assert one.name in offered, f"{where}: not offered there"


@pytest.mark.parametrize("door", DOORS, ids=_id)
def test_a_door_says_what_the_room_is_for_and_what_it_offers(door):
    assert (ast.get_docstring(door.tree) or "").endswith(".")
    package = importlib.import_module(door.name)
    modules = {name.rpartition(".")[2] for name in MODULES if name.rpartition(".")[0] == door.name}
    for name in package.__all__:
        value = getattr(package, name)
        within = isinstance(value, ModuleType) and value.__name__ == f"{door.name}.{name}"
        assert within or name not in modules, f"Python would put the module {name} in its place"


@pytest.mark.parametrize("door", DOORS, ids=_id)
def test_a_folder_reads_as_a_table_of_contents(door):
    hidden = {"__init__.py", "py.typed", "__pycache__"}
    entries = {path.name for path in door.path.parent.iterdir()} - hidden
    assert len(entries) <= MOST_ENTRIES, sorted(entries)


def test_the_users_door_offers_what_type_checkers_are_told():
    (block,) = (n for n in MODULES["integ_gym"].tree.body if isinstance(n, ast.If))
    told = {alias.name for node in block.body for alias in node.names}
    assert told == set(integ_gym.__all__)


def test_type_checkers_see_the_files_themselves():
    """By links to all that is imported: a copy would be checked in their place."""
    seen = {path.name: path for path in (ROOT / ".typing" / "integ_gym").iterdir()}
    entries = {path.name for path in (ROOT / "package").iterdir()} - {"py.typed", "__pycache__"}
    assert set(seen) == entries | set(FLOORS[:-1])
    for name, path in seen.items():
        assert path.is_symlink(), name
        assert path.resolve() == (ROOT / ("" if name in FLOORS else "package") / name).resolve()


def test_a_name_that_is_not_offered_is_refused():
    with pytest.raises(AttributeError, match="module 'integ_gym' has no attribute 'no_such'"):
        integ_gym.no_such  # noqa: B018


ORDERS = """
import importlib
FIRST
import integ_gym
packages = PACKAGES
for name in packages: importlib.import_module(name)
for name in integ_gym.__all__:
    value = getattr(integ_gym, name)
    assert f"integ_gym.{name}" not in packages, name
"""


@pytest.mark.parametrize("first", ["", *(f"import integ_gym.{n}" for n in FLOORS[:-1])])
def test_no_public_name_is_taken_by_a_package(first):
    """In whichever order the house is entered."""
    packages = [door.name for door in DOORS if door.name.count(".") == 1]
    assert packages
    code = ORDERS.replace("FIRST", first).replace("PACKAGES", repr(packages))
    subprocess.run([sys.executable, "-c", code], check=True)
