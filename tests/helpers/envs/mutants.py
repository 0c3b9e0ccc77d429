"""Planted faults: integrators and plants that are wrong in one place."""

from __future__ import annotations

import ast
import inspect
import textwrap
from functools import cached_property

from integ_gym.envs.integrators.euler import ExplicitEuler, SymplecticEuler
from integ_gym.envs.integrators.implicit import ImplicitEuler, ImplicitMidpoint, StormerVerlet
from integ_gym.envs.integrators.interface import Step
from integ_gym.envs.integrators.rk4 import RK4
from integ_gym.envs.ops.ops import along


class ExplicitForSymplectic(SymplecticEuler):
    """Explicit Euler under the name of the symplectic one."""

    step = ExplicitEuler.step


class SymplecticForExplicit(ExplicitEuler):
    """Symplectic Euler under the name of the explicit one."""

    step = SymplecticEuler.step


class PositionFirst(SymplecticEuler):
    """The other symplectic Euler: drift, then kick."""

    def step(self, ops, system, q, v, losses, control, dt):
        drifted = along(q, dt, v)
        acceleration, loss_rates = system.rates(ops, drifted, v, control)
        return Step(drifted, along(v, dt, acceleration), along(losses, dt, loss_rates))


class ExplicitVerlet(StormerVerlet):
    """Kick, drift, kick, with both kicks at known velocities."""

    def step(self, ops, system, q, v, losses, control, dt):
        half = 0.5 * dt
        acceleration, loss_rates = system.rates(ops, q, v, control)
        kicked = along(v, half, acceleration)
        losses = along(losses, half, loss_rates)
        drifted = along(q, dt, kicked)
        acceleration, loss_rates = system.rates(ops, drifted, kicked, control)
        losses = along(losses, half, loss_rates)
        return Step(drifted, along(kicked, half, acceleration), losses)


class RectangleLedger(RK4):
    """Right motion; dissipation booked at the power of the start of the step."""

    def step(self, ops, system, q, v, losses, control, dt):
        end = super().step(ops, system, q, v, losses, control, dt)
        _, loss_rates = system.rates(ops, q, v, control)
        return end._replace(losses=along(losses, dt, loss_rates))


class TrapezoidLedger(RK4):
    """Right motion; dissipation booked at the mean power of both ends of the step."""

    def step(self, ops, system, q, v, losses, control, dt):
        end = super().step(ops, system, q, v, losses, control, dt)
        _, before = system.rates(ops, q, v, control)
        _, after = system.rates(ops, end.q, end.v, control)
        losses = along(along(losses, 0.5 * dt, before), 0.5 * dt, after)
        return end._replace(losses=losses)


def _one_iteration(owner):
    """An implicit integrator whose solver stops after one iteration and reports success."""

    class OneIteration(owner):
        solver_cap = 1

        def step(self, *arguments):
            return super().step(*arguments)._replace(residual=0.0, converged=True)

    return OneIteration


EulerOneIteration = _one_iteration(ImplicitEuler)
MidpointOneIteration = _one_iteration(ImplicitMidpoint)
VerletOneIteration = _one_iteration(StormerVerlet)


def without_booked_damping(owner):
    """A plant whose damping acts and is not booked."""
    return type(owner)(f"{owner.__name__}Unbooked", (owner,), {"dissipation": lambda *_: 0.0})


def sign_errors(owner, method):
    """Subclasses of `owner`, each with one + or − of `method` turned into the other."""
    return _faulty(owner, method, getattr(owner, method), _flip_sign)


def wrong_numbers(owner, method):
    """Subclasses of `owner`, each with one float of `method` a tenth larger."""
    return _faulty(owner, method, getattr(owner, method), _enlarge)


def wrong_helper(owner, method, helper):
    """Subclasses of `owner` whose `method` calls a function with one wrong float or sign."""
    function = getattr(inspect.getmodule(owner), helper)
    return [
        fault
        for change in (_flip_sign, _enlarge)
        for fault in _faulty(owner, method, function, change)
    ]


def wrong_constants(owner):
    """Subclasses of `owner`, each with one derived constant, number or sign of it wrong."""
    faults = []
    for name, value in vars(owner).items():
        if isinstance(value, cached_property) and isinstance(getattr(owner(), name), float):
            faults.append(_scaled(owner, name))
            for change in (_enlarge, _flip_sign):
                faults += _faulty(owner, name, value.func, change)
    return faults


def _scaled(owner, name):
    larger = cached_property(lambda plant: 1.1 * getattr(owner, name).func(plant))
    return type(owner)(f"{owner.__name__}_{name}_scaled", (owner,), {name: larger})


def reference(owner):
    """The integrator argument that loads a class made here."""
    globals()[owner.__name__] = owner
    return f"{__name__}:{owner.__name__}"


def _faulty(owner, method, function, change):
    source = textwrap.dedent(inspect.getsource(function))
    faults, index = [], 0
    while (tree := change(ast.parse(source), index)) is not None:
        name = f"{owner.__name__}_{function.__name__}_{change.__name__}_{index}"
        faults.append(_with_fault(owner, method, tree, name))
        index += 1
    return faults


def _flip_sign(tree, index):
    opposite = {ast.Add: ast.Sub, ast.Sub: ast.Add}
    sums = [n for n in ast.walk(tree) if isinstance(n, ast.BinOp) and type(n.op) in opposite]
    nodes = [n for n in sums if not _vanishes(n.right)]
    if index >= len(nodes):
        return None
    nodes[index].op = opposite[type(nodes[index].op)]()
    return tree


def _vanishes(node):
    """0.0 * x, whose sign is nothing."""
    return (
        isinstance(node, ast.BinOp)
        and isinstance(node.op, ast.Mult)
        and isinstance(node.left, ast.Constant)
        and node.left.value == 0.0
    )


def _enlarge(tree, index):
    constants = [n for n in ast.walk(tree) if isinstance(n, ast.Constant)]
    nodes = [n for n in constants if isinstance(n.value, float) and n.value != 0.0]
    if index >= len(nodes):
        return None
    nodes[index].value *= 1.1
    return tree


def _with_fault(owner, method, tree, name):
    """A subclass of `owner` whose method runs with the changed function in place."""
    namespace = dict(vars(inspect.getmodule(owner)))
    sources = [tree]
    if tree.body[0].name != method:
        sources.append(ast.parse(textwrap.dedent(inspect.getsource(getattr(owner, method)))))
    for source in sources:
        exec(compile(source, f"<{name}>", "exec"), namespace)
    return type(owner)(name, (owner,), {method: namespace[method]})
