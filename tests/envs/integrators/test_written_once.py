"""The physics is written once: no second equation of motion, no second integration step."""

import ast
import inspect

import pytest
from gymnasium.envs.classic_control import cartpole, pendulum
from house import FLOORS, ROOT

PLANTS, INTEGRATORS = ROOT / "envs" / "plants", ROOT / "envs" / "integrators"
ENGINES, TESTBEDS = ROOT / "envs" / "engines", ROOT / "envs" / "testbeds"
MAPS, OPS = ROOT / "envs" / "engines" / "maps.py", ROOT / "envs" / "ops" / "ops.py"
EQUATIONS = {"acceleration", "dissipation", "mass_matrix", "jacobian"}
"""Methods in which a plant writes its physics."""
STEPS = {"dt", "h", "half", "tau", "timestep", "step_size", "kick", "drift"}
"""Names of a time step."""


def _tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def _name(node):
    """Of a variable or an attribute, or nothing."""
    return (getattr(node, "id", "") or getattr(node, "attr", "")).strip("_")


def _names(node):
    return {_name(inner) for inner in ast.walk(node)} - {""}


def equations_of_motion(tree):
    """Methods that are named as a plant's, and products of gravity with a sine or cosine."""
    found = [
        f"{owner.name}.{node.name}"
        for owner in ast.walk(tree)
        if isinstance(owner, ast.ClassDef)
        for node in owner.body
        if isinstance(node, ast.FunctionDef) and node.name in EQUATIONS
    ]
    waves = {"sin", "cos", "tan"} | {
        name
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign) and _names(node.value) & {"sin", "cos", "tan"}
        for target in node.targets
        for name in _names(target)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Mult, ast.Div)):
            names = _names(node)
            heavy = any(n == "g" or "gravity" in n or "weight" in n for n in names)
            if heavy and names & waves:
                found.append(ast.unparse(node))
    return found


def integration_steps(tree):
    """Functions named for a step of (q, v) or along a slope, and sums x + h · slope."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and "step" in node.name:
            names = {a.arg for a in node.args.args}
            if {"q", "v"} <= names or "slope" in names:
                found.append(node.name)
        parts = ()
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
            parts = node.left, node.right
        if isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add):
            parts = (node.value,)
        for part in parts:
            product = isinstance(part, ast.BinOp) and isinstance(part.op, ast.Mult)
            if product and {_name(part.left), _name(part.right)} & STEPS:
                found.append(ast.unparse(node))
    return found


def test_the_physics_is_written_once():
    sources = [path for floor in FLOORS for path in (ROOT / floor).rglob("*.py")]
    assert len(sources) > 100
    for path in sources:
        tree = _tree(path)
        if path == OPS:
            tree.body = [n for n in tree.body if getattr(n, "name", "") != "along"]
        if not {PLANTS, INTEGRATORS} & set(path.parents):
            found = equations_of_motion(tree)
            if {ENGINES, TESTBEDS} & set(path.parents):  # asked of a simulator
                found = [one for one in found if not one.endswith(".acceleration")]
            assert found == [], path
        if INTEGRATORS not in path.parents and path != MAPS:
            assert integration_steps(tree) == [], path


@pytest.mark.parametrize("module", [cartpole, pendulum], ids=lambda m: m.__name__)
def test_a_second_copy_would_be_found(module):
    """Gymnasium's own files, which hold both, stand for it."""
    tree = ast.parse(inspect.getsource(module))
    assert equations_of_motion(tree)
    assert integration_steps(tree)


def test_plants_and_integrators_import_no_arithmetic():
    for path in (*PLANTS.rglob("*.py"), *INTEGRATORS.rglob("*.py"), MAPS):
        nodes = list(ast.walk(_tree(path)))
        imported = {n.module or "" for n in nodes if isinstance(n, ast.ImportFrom)}
        imported |= {a.name for n in nodes if isinstance(n, ast.Import) for a in n.names}
        roots = {name.partition(".")[0] for name in imported}
        assert not roots & {"numpy", "jax", "math", "cmath", "scipy"}, path
