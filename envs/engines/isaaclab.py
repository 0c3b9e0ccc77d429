"""A mechanism in Universal Scene Description, text."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Mapping
from math import pi
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from integ_gym.support.errors import InputError
from integ_gym.support.isolated import ISOLATED, Worker

from ..mechanics import Link, Mechanism
from ..ops.ops import Component, Components
from .rigid import Array, LanesEngine, moment
from .simulator import Run

ROOT = "mechanism"
"""Name of the prim that holds the bodies."""

LEAST_INERTIA = 1.1e-10
"""Of a body, kg m^2: Newton raises what is below 1e-10 by 1e-6."""

_JOINTS = {"slide": "Prismatic", "hinge": "Revolute"}


def usd(mechanism: Mechanism) -> str:
    """An articulation without shapes, whose ground is fixed to the world.

    Joints have no drive and no limit. Gravity is the scene's, and not in here.

    Args:
        mechanism: with numbers as parameters.
    """
    parts = [_body("ground", 1.0, 0.0, 1.0), _joint("Fixed", "ground_joint", None, "ground")]
    parent = "ground"
    for link, offset in zip(mechanism.links, mechanism.offsets, strict=True):
        turns = link.joint == "hinge"
        inertia = max(moment(link), LEAST_INERTIA) if turns else link.mass  # which never turns
        parts += [_body(link.coordinate, link.mass, link.centre, inertia)]
        parts += [_moving(link, parent, offset)]
        parent = link.coordinate
    return (
        f'#usda 1.0\n(\n    defaultPrim = "{ROOT}"\n    kilogramsPerUnit = 1\n'
        '    metersPerUnit = 1\n    upAxis = "Z"\n)\n'
        f'def Xform "{ROOT}" (prepend apiSchemas = ["PhysicsArticulationRootAPI"])\n'
        f"{{\n{''.join(parts)}}}\n"
    )


def _body(name: str, mass: object, centre: object, inertia: object) -> str:
    return (
        f'    def Xform "{name}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])\n'
        f"    {{\n        float physics:mass = {mass!r}\n"
        f"        point3f physics:centerOfMass = (0, 0, {centre!r})\n"
        f"        float3 physics:diagonalInertia = ({inertia!r}, {inertia!r}, {inertia!r})\n"
        "        quatf physics:principalAxes = (1, 0, 0, 0)\n    }\n"
    )


def _moving(link: Link, parent: str, offset: Component) -> str:
    if sum(link.axis) < 0:
        raise InputError(
            f"engine 'isaaclab' has joints along x, y and z, and that of {link.coordinate!r} goes "
            "against one of them; use another engine"
        )
    axis = "XYZ"[link.axis.index(1)]
    per_degree = pi / 180.0 if link.joint == "hinge" else 1.0
    place = f"        point3f physics:localPos0 = (0, 0, {offset!r})\n" if offset else ""
    return _joint(
        _JOINTS[link.joint],
        f"{link.coordinate}_joint",
        parent,
        link.coordinate,
        f'        uniform token physics:axis = "{axis}"\n'
        f"{place}"
        f"        float newton:damping = {link.damping * per_degree!r}\n",
    )


def _joint(kind: str, name: str, parent: str | None, child: str, more: str = "") -> str:
    body0 = "" if parent is None else f"        rel physics:body0 = </{ROOT}/{parent}>\n"
    return (
        f'    def Physics{kind}Joint "{name}"\n    {{\n{body0}'
        f"        rel physics:body1 = </{ROOT}/{child}>\n{more}    }}\n"
    )


SERVED = Path(__file__).with_name("isaaclab_served.py")

STARTING = 900.0
"""Time in which Isaac Lab is imported and a scene made, its programs compiled, s."""

FEWEST = 16
"""Lanes of a scene for a vector environment, or the next power of two above it."""

_idle: list[Worker] = []
"""At most one process that no engine uses: a new engine need not wait for Isaac Lab's import."""


class IsaaclabEngine(LanesEngine):
    """An articulation of Isaac Lab's in float32, one scene for all lanes of a vector environment.

    `euler`, `implicitfast` and `rk4` are Newton's MuJoCo solver, `featherstone` its own. Isaac Lab
    has one simulation in a process, so that each engine has a process of its own. Plants have no
    actuators there: a control is a joint effort, and damping is passive.
    """

    name: ClassVar[str] = "isaaclab"
    package: ClassVar[str] = "isaaclab"
    modules: ClassVar[tuple[str, ...]] = ()
    width: int = 32
    own_stops: ClassVar[bool] = False
    least_inertia: ClassVar[float] = LEAST_INERTIA
    maps: ClassVar[Mapping[str, str]] = {
        "euler": "symplectic_euler_implicit_damping",
        "implicitfast": "symplectic_euler_implicit_damping",
        "rk4": "rk4",
        "featherstone": "symplectic_euler",
    }

    def build(self) -> None:
        """Start a process, and make a scene of one lane."""
        self._worker = _borrow_worker()
        weakref.finalize(self, _give_back, self._worker)
        self._lanes = 0
        self._make(1)

    def describe(self) -> dict[str, Any]:
        """As every engine, and the versions of what does the physics."""
        return {**super().describe(), "versions": self._versions}

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix of the solver, and all of the generalized force."""
        mass, force = self._worker.call("at_rest", q=list(q))
        return np.array(mass), np.array(force)

    def run(self, count: int) -> Run:
        """Take ``count`` steps of the first lane."""
        return lambda *start: tuple(self.run_lanes(np.array([start]), count)[0].tolist())

    def run_lanes(self, starts: Array, count: int) -> Array:
        """Take ``count`` steps of at least as many lanes as there are."""
        if len(starts) > self._lanes:
            self._make(max(FEWEST, 1 << (len(starts) - 1).bit_length()))
        return np.array(self._worker.call("run", starts=starts.tolist(), count=count))

    def _make(self, lanes: int) -> None:
        """Make the scene anew, with so many lanes."""
        self._versions = self._worker.call(
            "make", STARTING, usd=usd(self.mechanism), gravity=float(self.mechanism.gravity),
            joints=[link.coordinate for link in self.mechanism.links],
            integrator=self.integrator, dt=self.dt, lanes=lanes,
        )  # fmt: skip
        self._lanes = lanes


def _borrow_worker() -> Worker:
    """An idle process, that of an engine which is no longer referred to too; or a new one."""
    if not _idle:
        gc.collect()
    return _idle.pop() if _idle else ISOLATED[IsaaclabEngine.name].start(SERVED)


def _give_back(worker: Worker) -> None:
    if _idle or not worker.close.alive:
        worker.close()
    else:
        _idle.append(worker)
