"""DART, the physics of Gazebo."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan
from typing import Any, ClassVar

import numpy as np

from integ_gym.support.errors import InputError
from integ_gym.support.optional import load
from integ_gym.support.parameters import unknown_name

from ..mechanics import Link
from ..ops.ops import Components
from .rigid import Array, RigidBodyEngine, moment
from .simulator import Run, is_astray
from .stepping import check_settings, solver_with

PGS = {
    "maxIteration": 30,
    "deltaXTolerance": 1e-6,
    "relativeDeltaXTolerance": 1e-3,
    "epsilonForDivision": 1e-9,
}
"""Arguments of DART's `PgsBoxedLcpSolverOption`, with its own values."""

_LCP = "boxedLcpSolver"
_SOLVERS = ("DantzigBoxedLcpSolver", "PgsBoxedLcpSolver")
"""What solves for joint limits: where Dantzig's fails, the other; its own value is the first."""

_JOINTS = {"slide": "Prismatic", "hinge": "Revolute"}


class DartEngine(RigidBodyEngine):
    """DART's `World.step`, in float64: symplectic Euler with joint damping taken implicitly.

    DART puts resting bodies to sleep by default; that is turned off, so that a step depends on
    nothing that went before.
    """

    name: ClassVar[str] = "dart"
    package: ClassVar[str] = "dartpy"
    modules: ClassVar[tuple[str, ...]] = ("dartpy",)
    maps: ClassVar[Mapping[str, str]] = {
        "semi_implicit_euler": "symplectic_euler_implicit_damping",
    }
    solver_defaults: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "semi_implicit_euler": {_LCP: _SOLVERS[0], **PGS}
    }

    def read_solver(self, given: Mapping[str, Any]) -> None:
        """Take which solver comes first, and numbers of the projected Gauss-Seidel one."""
        own = self.solver_defaults[self.integrator]
        check_settings(self.name, given, own)
        first = given.get(_LCP, own[_LCP])
        if first not in _SOLVERS:
            raise InputError(unknown_name(f"`solver.{_LCP}`", str(first), _SOLVERS))
        numbers = {name: value for name, value in given.items() if name != _LCP}
        self.settings = {_LCP: first, **solver_with(self.name, PGS, numbers)}

    def build(self) -> None:
        """Make the world with the mechanism as its only skeleton."""
        dart = load("dartpy", "dart")
        self._skeleton = dart.dynamics.Skeleton(self.system.plant.name)
        body = None
        for link, offset in zip(self.mechanism.links, self.mechanism.offsets, strict=True):
            body = self._hang(dart, body, link, offset)
        self._world = dart.simulation.World()
        self._world.setTimeStep(self.dt)
        self._world.setGravity((0.0, 0.0, -self.mechanism.gravity))
        awake = self._world.getDeactivationOptions()
        awake.mEnabled = False
        self._world.setDeactivationOptions(awake)
        self._world.addSkeleton(self._skeleton)
        first, *numbers = self.settings.values()
        solver, other = (w.getConstraintSolver() for w in (self._world, dart.simulation.World()))
        pgs = solver.getSecondaryBoxedLcpSolver()
        if first == pgs.getType():
            solver.setBoxedLcpSolver(pgs := other.getSecondaryBoxedLcpSolver())
            solver.setSecondaryBoxedLcpSolver(other.getBoxedLcpSolver())
        pgs.setOption(dart.constraint.PgsBoxedLcpSolverOption(*numbers))
        self.settings = {**self.settings, _LCP: solver.getBoxedLcpSolver().getType()}
        self._law = dart.constraint.JointConstraint

    def stop_parameters(self) -> dict[str, Any]:
        """Parameters of DART's joint constraints, which are the process's, and their solver's."""
        return {
            **self.settings,
            "error_allowance": self._law.getErrorAllowance(),
            "error_reduction_parameter": self._law.getErrorReductionParameter(),
            "max_error_reduction_velocity": self._law.getMaxErrorReductionVelocity(),
            "constraint_force_mixing": self._law.getConstraintForceMixing(),
        }

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix and force of gravity, which DART has on the side of the accelerations."""
        self._skeleton.setPositions(q)
        gravity = -np.array(self._skeleton.getGravityForces())
        return np.array(self._skeleton.getMassMatrix()), gravity

    def forward_dynamics(self, q: Components, v: Components, force: Components) -> Array:
        """By the mass matrix; DART's own takes damping as at the end of a step."""
        skeleton = self._skeleton
        skeleton.setPositions(q)
        skeleton.setVelocities(v)
        damping = np.array([link.damping for link in self.mechanism.links])
        bias = np.array(skeleton.getCoriolisAndGravityForces()) + damping * v
        return np.linalg.solve(skeleton.getMassMatrix(), force - bias)

    def run(self, count: int) -> Run:
        """Take ``count`` steps under forces that no limit clamps.

        What is astray ends them: DART would warn, and go on without what is not finite.
        """
        skeleton, step = self._skeleton, self._world.step
        n = int(skeleton.getNumDofs())
        places = tuple(range(n))
        put_position, position = skeleton.setPosition, skeleton.getPosition
        put_velocity, velocity = skeleton.setVelocity, skeleton.getVelocity
        put_force, lost = skeleton.setForce, (nan,) * (2 * n)

        def run(*values: float) -> tuple[float, ...]:
            if is_astray(values):
                return lost
            for i in places:
                put_position(i, values[i])
                put_velocity(i, values[n + i])
                put_force(i, values[2 * n + i])
            speeds: tuple[float, ...] = ()
            for _ in range(count):
                step(False)
                speeds = tuple([velocity(i) for i in places])
                if is_astray(speeds):
                    return lost
            return (*[position(i) for i in places], *speeds)

        return run

    def _hang(self, dart: Any, parent: Any, link: Link, offset: float) -> Any:
        """Hang a link on a body, or on the ground where that is None; its own body."""
        create = getattr(self._skeleton, f"create{_JOINTS[link.joint]}JointAndBodyNodePair")
        joint, body = create() if parent is None else create(parent)
        place = dart.math.Isometry3()
        place.set_translation((0.0, 0.0, offset))
        joint.setTransformFromParentBodyNode(place)
        joint.setAxis([float(x) for x in link.axis])
        joint.setDampingCoefficient(0, link.damping)
        moments = moment(link) * np.eye(3)
        body.setInertia(dart.dynamics.Inertia(link.mass, (0.0, 0.0, link.centre), moments))
        if link.limit is not None:
            joint.setPositionLowerLimit(0, -link.limit)
            joint.setPositionUpperLimit(0, link.limit)
            joint.setLimitEnforcement(True)
        return body
