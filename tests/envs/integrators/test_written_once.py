"""The physics is written once: no second equation of motion, no second integration step."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import pytest
from gymnasium.envs.classic_control import cartpole, pendulum
from house import FLOORS, ROOT
from written_once import equations_of_motion, integration_steps

from integ_gym.envs.registries import INTEGRATORS as INTEGRATORS_BY_NAME

SOURCES = sorted(path for folder in FLOORS for path in (ROOT / folder).rglob("*.py"))
PLANTS = ROOT / "envs" / "plants"
INTEGRATORS = ROOT / "envs" / "integrators"
MAPS = ROOT / "envs" / "engines" / "maps.py"
METHODS = ("interface", "newton")
"""Of the files of integrators, those that are none."""
PURE = [*sorted(path for folder in (PLANTS, INTEGRATORS) for path in folder.rglob("*.py")), MAPS]
FORCES = [ROOT / "envs" / "mechanics.py"]
OPS = ROOT / "envs" / "ops" / "ops.py"
"""Its `along` is the one step times a slope that integrators and maps are made of."""


def _id(path: Path) -> str:
    return str(path.relative_to(ROOT))


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _takes_steps(path: Path) -> bool:
    """Whether a module holds integration steps, or is made of `along`."""
    tree = _tree(path)
    imported = [n.names for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    return any(a.name == "along" for names in imported for a in names) or any(
        integration_steps(tree)
    )


def _within(path: Path, *folders: Path) -> bool:
    return any(folder in path.parents for folder in folders)


@pytest.mark.parametrize("path", SOURCES, ids=_id)
def test_the_physics_is_written_once(path):
    if not _within(path, PLANTS, INTEGRATORS):
        assert equations_of_motion(_tree(path)) == []
    if not _within(path, INTEGRATORS) and path != MAPS:
        tree = _tree(path)
        if path == OPS:
            tree.body = [n for n in tree.body if getattr(n, "name", "") != "along"]
        assert integration_steps(tree) == []


def test_the_sources_are_those_of_the_project():
    assert {_id(path).split("/")[0] for path in SOURCES} == set(FLOORS)
    assert len(PURE) >= 10
    assert all(path.exists() for path in FORCES)


@pytest.mark.parametrize("module", [cartpole, pendulum], ids=lambda m: m.__name__)
def test_a_second_copy_would_be_found(module):
    """Gymnasium's own files, which hold both, stand for it."""
    tree = ast.parse(inspect.getsource(module))
    assert equations_of_motion(tree)
    assert integration_steps(tree)


@pytest.mark.parametrize("path", PURE, ids=_id)
def test_plants_hold_equations_and_integrators_hold_steps(path):
    """What the search finds where it should: every plant, every integrator."""
    if path.parent == PLANTS and path.stem not in ("__init__", "interface"):
        assert equations_of_motion(_tree(path))
        assert not integration_steps(_tree(path))
    if path == MAPS or (path.parent == INTEGRATORS and path.stem not in ("__init__", *METHODS)):
        assert _takes_steps(path)
        assert not equations_of_motion(_tree(path))


@pytest.mark.parametrize("path", [*PURE, *FORCES], ids=_id)
def test_plants_and_integrators_import_no_arithmetic(path):
    imported = set()
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Import):
            imported |= {alias.name.split(".")[0] for alias in node.names}
        if isinstance(node, ast.ImportFrom) and node.module:
            imported.add(node.module.split(".")[0])
    assert not imported & {"numpy", "jax", "math", "cmath", "scipy"}


@pytest.mark.parametrize("name", INTEGRATORS_BY_NAME.parts)
def test_an_integrator_is_short(name):
    assert len(inspect.getsource(INTEGRATORS_BY_NAME.load(name)).splitlines()) < 100
