"""Finds equations of motion and integration steps in source code."""

from __future__ import annotations

import ast

EQUATIONS = {"acceleration", "dissipation", "mass_matrix", "jacobian"}
"""Methods in which a plant writes its physics."""

STEPS = {"dt", "h", "half", "tau", "timestep", "step_size", "kick", "drift"}
"""Names of a time step."""

TRIGONOMETRY = {"sin", "cos", "tan"}


def equations_of_motion(tree: ast.AST) -> list[str]:
    """Methods that are named as a plant's, and products of gravity with a sine or cosine."""
    found = [
        f"{owner.name}.{node.name}"
        for owner in ast.walk(tree)
        if isinstance(owner, ast.ClassDef)
        for node in owner.body
        if isinstance(node, ast.FunctionDef) and node.name in EQUATIONS
    ]
    waves = _names_of_waves(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Mult, ast.Div)):
            inside = list(ast.walk(node))
            if any(_is_gravity(n) for n in inside) and any(_is_wave(n, waves) for n in inside):
                found.append(ast.unparse(node))
    return found


def integration_steps(tree: ast.AST) -> list[str]:
    """Functions named for a step of (q, v) or along a slope, and sums x + h · slope."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and "step" in node.name:
            names = {a.arg for a in node.args.args}
            if {"q", "v"} <= names or "slope" in names:
                found.append(node.name)
        if any(_is_step_times_slope(part) for part in _summands(node)):
            found.append(ast.unparse(node))
    return found


def _summands(node: ast.AST) -> tuple[ast.AST, ...]:
    """What a sum, or a statement `x += …`, adds."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return node.left, node.right
    if isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add):
        return (node.value,)
    return ()


def _is_step_times_slope(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.BinOp)
        and isinstance(node.op, ast.Mult)
        and any(_name(side) in STEPS for side in (node.left, node.right))
    )


def _is_gravity(node: ast.AST) -> bool:
    name = _name(node)
    return name == "g" or "gravity" in name or "weight" in name


def _is_wave(node: ast.AST, waves: set[str]) -> bool:
    called = isinstance(node, ast.Call) and _name(node.func) in TRIGONOMETRY
    return called or (isinstance(node, ast.Name) and node.id in waves)


def _names_of_waves(tree: ast.AST) -> set[str]:
    """Variables that a sine or cosine is assigned to."""
    return {
        target.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign) and any(_is_wave(n, set()) for n in ast.walk(node.value))
        for outer in node.targets
        for target in ast.walk(outer)
        if isinstance(target, ast.Name)
    }


def _name(node: ast.AST) -> str:
    if isinstance(node, ast.Name):
        return node.id.strip("_")
    return node.attr.strip("_") if isinstance(node, ast.Attribute) else ""
