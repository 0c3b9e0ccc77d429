"""Plants as rigid bodies, which simulators are given and compared with."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cache
from math import nan
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from integ_gym.support.errors import InputError

from ..integrators.interface import State, Step
from ..mechanics import LEAST_SHARE, Link, Mechanism, Rates, Slopes
from ..ops.ops import SCALAR, Component, Components, Ops, along, rows_of
from ..plants.contact import Stops
from ..plants.interface import Plant
from .maps import one_step_map
from .simulator import ASTRAY, ForeignEngine, Run

Array = npt.NDArray[np.float64]

TOLERANCE = {64: 1e-9, 32: 1e-5}
"""Largest relative error of a mass matrix or gravity force, by the width of the engine's floats."""

EXPLICIT_FORCES = (
    "symplectic_euler",
    "symplectic_euler_implicit_damping",
    "symplectic_euler_sequential_damping",
)
"""Maps that take all forces but damping at the start of a step alone, and the lag of a control."""

_PROBES = ((0.3, -0.7), (-1.1, 2.2), (0.6, 1.4))


def probes(n: int) -> tuple[Components, ...]:
    """Configurations of n joints at which an engine is compared with the plant."""
    return tuple((pair * n)[-n:] for pair in _PROBES)


def mechanism_of(engine: str, plant: Plant) -> Mechanism:
    """The plant's links.

    Raises:
        ValueError: if it has none or not one for each coordinate with mass, and if their dampers do
            not take what the plant's damping takes.
    """
    mechanism: Mechanism | None = getattr(plant, "mechanism", None)
    if mechanism is None:
        raise InputError(
            f"engine {engine!r} moves rigid links, and the plant {plant.name!r} has none: it gives "
            "no `mechanism`; use engine 'native' or 'casadi'"
        )
    moving = len(plant.coordinates) - len(getattr(plant, "massless", ()))
    if len(mechanism.links) != moving:
        raise InputError(
            f"plant {plant.name!r} has {moving} coordinates with mass and its `mechanism` "
            f"{len(mechanism.links)} links; give one for each"
        )
    for q in probes(len(plant.coordinates)):
        pairs = zip(mechanism.links, q[:moving], strict=True)
        expected = sum(link.damping * x * x for link, x in pairs)
        power = plant.dissipation(SCALAR, q, q)
        if not np.isclose(power, expected, rtol=1e-12, atol=0.0):
            raise InputError(
                f"plant {plant.name!r} loses {power:g} W to damping at q = v = {q}, where the "
                f"dampers of its `mechanism` take {expected:g} W; give its links the same damping"
            )
    return mechanism.solid


def check_agreement(model: Any, plant: Plant) -> None:
    """Compare mass matrix and gravity force with the plant's.

    Args:
        model: an engine with a model of its own, which :meth:`RigidBodyEngine.at_rest` tells of.
        plant: with numbers as parameters; of those of its coordinates that have a mass.

    Raises:
        ValueError: if they differ.
    """
    n = len(model.system.moving)
    for q in probes(len(plant.coordinates)):
        expected = joint_masses(plant, q[:n])
        still = (0.0,) * len(q)
        weight = expected @ np.array(plant.acceleration(SCALAR, q, still, still)[:n])
        weight -= plant.mechanism.spring_forces(q)  # type: ignore[attr-defined]
        mass, gravity = model.at_rest(q[:n])
        for what, got, wanted in (
            ("mass matrix", mass, expected),
            ("gravity force", gravity, weight),
        ):
            scale = max(float(np.abs(wanted).max()), 1e-30)
            if not np.allclose(got, wanted, rtol=0.0, atol=TOLERANCE[model.width] * scale):
                raise InputError(
                    f"engine {model.name!r} {model.version} has another {what} than the plant at "
                    f"q = {q}: {np.asarray(got).tolist()} for {wanted.tolist()}; this version "
                    "of the engine cannot be compared"
                )


def joint_masses(plant: Plant, q: Components) -> Array:
    """The plant's mass matrix, (n, n), of its n coordinates with mass."""
    n, others = len(q), (0.0,) * (len(plant.coordinates) - len(q))
    return np.array(plant.mass_matrix(SCALAR, (*q, *others)), dtype=np.float64)[:n, :n]


class RigidBodyEngine(ForeignEngine):
    """Builds the plant's mechanism in a simulator and advances it under generalized forces.

    Friction, stops and contact points are forces of our own, taken at the start of each step and
    held during it: a simulator takes generalized forces once in a step. Under a map that evaluates
    forces once that is the map's own law; any other is of first order where they act. Springs at
    joints are held likewise under those maps; under others they are the simulator's. Controls that
    are more than forces along coordinates are taken under :data:`EXPLICIT_FORCES` alone.
    Coordinates without mass advance beside the simulator, by symplectic Euler.

    Raises:
        ValueError: for a plant without a mechanism or whose damping is not its mechanism's, for
            one too light for the engine, and for an engine whose mass matrix or gravity force is
            not the plant's.
    """

    holds_resistance: ClassVar[bool] = True
    own_stops: ClassVar[bool] = True
    least_inertia: ClassVar[float] = 0.0
    """Moment of inertia of a body below which it takes none, kg m^2."""
    own_springs: ClassVar[bool] = False
    """Whether its joints have springs, which its map takes as it takes other forces."""
    tells_speeds: ClassVar[bool] = False
    """Whether it has a :meth:`run_with_speeds`."""

    def prepare(self) -> None:
        """Build the simulator's model, and compare it with the plant."""
        super().prepare()
        self._turning = self.system.input_forces is not None
        if self._turning and self.map not in EXPLICIT_FORCES:
            once = ", ".join(x for x, y in self.maps.items() if y in EXPLICIT_FORCES)
            raise InputError(
                f"engine {self.name!r} holds forces over a step, and those of the controls of "
                f"plant {self.system.plant.name!r} change within it under integrator "
                f"{self.integrator!r}; use `integrator`: {once}, or engine 'native', 'casadi' or "
                "'pinocchio'"
            )
        if self.system.servo is not None:
            raise InputError(
                f"engine {self.name!r} holds forces over a step, and a continuous servo changes "
                "within it; give `servo`='step' or 'period', or use engine 'native' or 'casadi'"
            )
        self.free = mechanism_of(self.name, self.system.plant)
        self.held_springs = self._take_springs()
        self.mechanism, stops = self.free, self.system.engine_stops
        if stops is not None:
            self.mechanism = self.free.stopped(stops.coordinate, stops.limit)
        self._map = one_step_map(self.map)
        self._map_losses_of = getattr(self._map, "losses_of", None)
        self._map_losses_between = getattr(self._map, "losses_between", None)
        self._run_with_speeds = cache(self.run_with_speeds)
        self._damped = any(link.damping for link in self.mechanism.links)
        self.build()
        self._check()

    def _take_springs(self) -> Mechanism | None:
        """The mechanism whose springs are held over a step, and are taken from the simulator's."""
        if not self.free.sprung:
            return None
        if self.map.startswith("symplectic_euler"):
            held, self.free = self.free, self.free.without_springs
            return held
        if self.own_springs:
            return None
        once = ", ".join(x for x, y in self.maps.items() if y.startswith("symplectic_euler"))
        raise InputError(
            f"springs at joints are not given to engine {self.name!r} here, so integrator "
            f"{self.integrator!r} cannot take them in all its stages; use `integrator`: {once}, or "
            "engine 'native', 'mujoco' or 'drake'"
        )

    def with_springs(self, q: Components, force: Components) -> Components:
        """A generalized force with that of the springs that are held over a step."""
        if self.held_springs is None:
            return force
        pulls = self.held_springs.spring_forces(q)
        pairs = zip(force, pulls, strict=False)
        return *[a + b for a, b in pairs], *force[len(pulls) :]

    @abstractmethod
    def build(self) -> None:
        """Make the simulator's model of :attr:`mechanism`, whose own stops :attr:`free` lacks."""

    @abstractmethod
    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """The simulator's mass matrix, (dof, dof), and its generalized force of gravity, (dof,)."""

    def forward_dynamics(self, q: Components, v: Components, force: Components) -> Array | None:
        """The simulator's accelerations under a generalized force, (dof,), if it reports any."""
        return None

    def acceleration(self, q: Components, v: Components, force: Components) -> Components | None:
        """The simulator's, with our stops and friction; None where it reports none."""
        n = len(self.mechanism.links)
        own = self.with_springs(q, self.system.with_resistance(SCALAR, q, v, force))
        found = self.forward_dynamics(q[:n], v[:n], own[:n])
        return None if found is None else (*found.tolist(), *force[n:])

    def _check(self) -> None:
        """Compare the model with the plant.

        Raises:
            ValueError: if they differ, and if the least moment of inertia that the engine takes
                makes a difference.
        """
        least = self.least_inertia
        for link in self.mechanism.links:
            about_joint = link.inertia + link.mass * link.centre**2
            tolerated = TOLERANCE[self.width] * about_joint
            if link.joint == "hinge" and about_joint and max(link.inertia, tolerated) < least:
                raise InputError(
                    f"engine {self.name!r} takes no body's moment of inertia below {least:g} "
                    f"kg m^2, which the plant's {about_joint:g} kg m^2 about {link.coordinate!r} "
                    "is too small for; use a larger mass or length, or an engine without this "
                    "limit, such as 'native', 'drake' or 'pinocchio'"
                )
        check_agreement(self, self.system.plant)

    @property
    def straight(self) -> bool:
        """Whether nothing is booked between steps but work and the damping of the steps."""
        system = self.system
        limited = system.speed_limits is not None or system.engine_stops is not None
        if system.steep or limited or self.held_springs is not None or self._turning:
            return False
        return not self._damped or (self.tells_speeds and self._map_losses_of is not None)

    def run_with_speeds(self, count: int) -> Run:
        """As :meth:`run`, with each velocity's mean square over the ends of steps after (q, v)."""
        raise NotImplementedError

    def stride(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        losses: Components,
        force: Components,
        count: int,
    ) -> Step:
        """Take ``count`` steps; lost is what joint damping takes."""
        if not self._damped:
            return super().stride(ops, q, v, losses, force, count)
        if count == 1:
            end_q, end_v, *report = self.travel_whole(ops, q, v, force, 1)
            speeds = v if self._map_losses_of == "start" else end_v
        else:
            end_q, end_v, squares, *report = self._travel_with_speeds(ops, q, v, force, count)
            if self._map_losses_of == "start":
                pairs = zip(squares, v, end_v, strict=True)
                squares = tuple([x + (a * a - b * b) / count for x, a, b in pairs])
            speeds = tuple([ops.sqrt(ops.maximum(0.0, x)) for x in squares])
        # Dampers at the joints: the mean power is that at the root mean square of each velocity.
        power = self.system.plant.dissipation(ops, end_q, speeds)
        lost = along(losses, count * self.dt, (power,))
        return Step(end_q, end_v, self._of_whole_steps(ops, lost, report[-1]), *report)

    def _travel_with_speeds(
        self, ops: Ops, q: Components, v: Components, force: Components, count: int
    ) -> tuple[Components, Components, Components, Component, Component, Component]:
        """As :meth:`travel`, with the mean squares of the velocities after q and v."""
        n, run = len(self.system.moving), self._run_with_speeds(count)
        flat, report = self._call_engine(ops, run, (*q[:n], *v[:n], *force[:n]), 3 * n)
        end = self.with_massless(q, v, force, count, (flat[:n], flat[n : 2 * n]))
        return *end, (*flat[2 * n :], *[x * x for x in v[n:]]), *report

    def move(
        self, ops: Ops, q: Components, v: Components, losses: Components, control: Components
    ) -> Step:
        """One of the simulator's steps, with friction, contact and losses."""
        resisting, rates = self.system.resistance(ops, q, v)
        drive = self.system.forces(ops, q, v, control)
        force = tuple([a + b for a, b in zip(drive, resisting, strict=True)])
        end_q, end_v, iterations, residual, converged = self.travel_whole(
            ops, q, v, self.with_springs(q, force), 1
        )
        if self._turning:
            losses = self._map.step(ops, self.system, q, v, losses, control, self.dt).losses
            return Step(end_q, end_v, losses, iterations, residual, converged)
        losses = along(losses, self.dt, rates)
        if self._damped:
            losses = (self._damping(ops, (q, v), (end_q, end_v), force, losses[0]), *losses[1:])
            losses = self._of_whole_steps(ops, losses, converged)
        if self.system.engine_stops is None:
            return Step(end_q, end_v, losses, iterations, residual, converged)
        push = self._push(ops, q, v, end_v, force)
        losses = (losses[0], ops.where(push == 0.0, losses[1], nan))
        return Step(end_q, end_v, losses, iterations, residual, converged, push)

    def _damping(
        self, ops: Ops, start: State, end: State, force: Components, loss: Component
    ) -> Component:
        """``loss`` with what joint damping takes in a step: as the map books it."""
        plant = self.system.plant
        if self._map_losses_of is not None:
            state = start if self._map_losses_of == "start" else end
            return along((loss,), self.dt, (plant.dissipation(ops, *state),))[0]
        held = HeldForce(plant, force)
        if self._map_losses_between is not None:
            return self._map_losses_between(ops, held, start, end, (loss,), 0.0, self.dt)[0]
        return self._map.step(ops, held, *start, (loss,), 0.0, self.dt).losses[0]

    def _of_whole_steps(self, ops: Ops, losses: Components, converged: Component) -> Components:
        """``losses``; that of damping is not known where the engine divided a step of its map."""
        if not self.reports or self.system.engine_stops is not None:
            return losses
        return (ops.where(converged, losses[0], nan), *losses[1:])

    def _push(
        self, ops: Ops, q: Components, v: Components, end: Components, force: Components
    ) -> Component:
        """Force of the engine's own stop: what it changed in the momentum, over the step; or 0.

        The energy that it took is not reported, so that the ledger is open where it acts.
        """
        held = HeldForce(self.system.plant, force)
        free = self._map.step(ops, held, q, v, (0.0,), 0.0, self.dt).v
        changes = [a - b for a, b in zip(end, free, strict=True)]
        assert self.system.engine_stops is not None
        row = self.system.plant.mass_matrix(ops, q)[self.system.engine_stops.coordinate]
        impulse = sum(a * b for a, b in zip(row, changes, strict=True))
        felt = abs(impulse) > TOLERANCE[self.width] * 10.0 * (1.0 + abs(free[0]))
        return ops.where(felt, impulse / self.dt, 0.0)


@dataclass(frozen=True)
class HeldForce:
    """A plant under a generalized force that is held: what an engine integrates in one step."""

    plant: Plant
    force: Components
    steep: ClassVar[bool] = False
    kinked: ClassVar[bool] = False

    def rates(self, ops: Ops, q: Components, v: Components, control: Components) -> Rates:
        """Accelerations, and the power of damping, W."""
        losses = (self.plant.dissipation(ops, q, v),)
        return self.plant.acceleration(ops, q, v, self.force), losses

    def slopes(self, ops: Ops, q: Components, v: Components, control: Components) -> Slopes | None:
        """(∂a/∂q, ∂a/∂v), or None if the plant gives none."""
        jacobian = getattr(self.plant, "jacobian", None)
        return None if jacobian is None else jacobian(ops, q, v, self.force)

    def limit(self, ops: Ops, v: Components) -> Components:
        """``v``: no limit acts within a step."""
        return v


MAPS: dict[str, str] = {
    "Euler": "symplectic_euler_implicit_damping",
    "implicitfast": "symplectic_euler_implicit_damping",
    "implicit": "symplectic_euler_implicit_velocity",
    "discrete": "symplectic_euler_implicit_damping",
    "RK4": "rk4",
}
"""MuJoCo's integrators, and the one-step maps that they apply."""

LEAST_INERTIA = 1.1e-15
"""Of a body, kg m^2: MuJoCo's compiler wants more than 1e-15."""


def moment(link: Link) -> float:
    """A link's moment of inertia, kg m^2, or one above zero that makes no difference.

    For simulators that take none of zero.
    """
    about_joint = link.mass * (link.centre**2 or 1.0)
    least: float = max(link.inertia, LEAST_SHARE * about_joint)
    return least


def mjcf(mechanism: Mechanism, dt: float, integrator: str, history: int = 0) -> str:
    """The model in MuJoCo's format, XML text; stops have MuJoCo's own parameters of contact.

    Args:
        mechanism: with numbers as parameters.
        dt: timestep, s.
        integrator: MuJoCo's name.
        history: of so many steps, the last, the data keeps the velocities of the start.
    """
    bodies = "".join(map(_opening, mechanism.links, mechanism.offsets))
    sensors = "".join(
        f'<jointvel joint="{link.coordinate}" nsample="{history}"/>'
        for link in mechanism.links
        if history
    )
    return (
        '<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option timestep="{dt!r}" integrator="{integrator}" gravity="0 0 {-mechanism.gravity!r}">'
        '<flag contact="disable"/></option>'
        f"<worldbody>{bodies}{'</body>' * len(mechanism.links)}</worldbody>"
        f"<sensor>{sensors}</sensor></mujoco>"
    )


def _opening(link: Link, offset: Component) -> str:
    inertia, limit = max(moment(link), LEAST_INERTIA), link.limit
    ends = "" if limit is None else f'limited="true" range="{-limit!r} {limit!r}" '
    spring = f'stiffness="{link.stiffness!r}" springref="{link.slack!r}" ' if link.stiffness else ""
    return (
        f'<body name="{link.coordinate}" pos="0 0 {offset!r}">'
        f'<joint name="{link.coordinate}" type="{link.joint}" axis="{_axis(link)}" '
        f'{ends}{spring}damping="{link.damping!r}"/>'
        f'<inertial pos="0 0 {link.centre!r}" mass="{link.mass!r}" '
        f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
    )


def _axis(link: Link) -> str:
    return " ".join(map(str, link.axis))


def stop_law(model: Any, stops: Stops | None) -> dict[str, Any]:
    """`solref` and `solimp` of the limited joint of a MuJoCo model."""
    assert stops is not None
    tables = {"solref": model.jnt_solref, "solimp": model.jnt_solimp}
    return {name: table[stops.coordinate].tolist() for name, table in tables.items()}


def mass_matrix(mujoco: Any, model: Any, data: Any) -> Array:
    """Of a MuJoCo model, (dof, dof), from data that hold it packed."""
    full = np.zeros((model.nv, model.nv))
    try:
        mujoco.mj_fullM(model, data, full)
    except TypeError:  # before 4.0
        mujoco.mj_fullM(model, full, data.qM)
    return full


def urdf(mechanism: Mechanism) -> str:
    """The model in the Unified Robot Description Format, XML text.

    A joint without a limit has its lower one above its upper one. The root link has no mass.

    Args:
        mechanism: with numbers as parameters.
    """
    parts, parent = [_body("ground", 0.0, 0.0, 0.0)], "ground"
    for link, offset in zip(mechanism.links, mechanism.offsets, strict=True):
        parts += [_body(link.coordinate, link.mass, link.centre, link.inertia)]
        parts += [_joint(link, parent, offset)]
        parent = link.coordinate
    return f'<robot name="mechanism">{"".join(parts)}</robot>'


def _body(name: str, mass: float, centre: float, inertia: float) -> str:
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 {centre!r}"/><mass value="{mass!r}"/>'
        f'<inertia ixx="{inertia!r}" iyy="{inertia!r}" izz="{inertia!r}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
    )


def _joint(link: Link, parent: str, offset: Component) -> str:
    kinds, ends = {"slide": "prismatic", "hinge": "continuous"}, 'lower="0" upper="-1"'
    if link.limit is not None:
        kinds["hinge"], ends = "revolute", f'lower="{-link.limit!r}" upper="{link.limit!r}"'
    return (
        f'<joint name="{link.coordinate}_joint" type="{kinds[link.joint]}">'
        f'<origin xyz="0 0 {offset!r}"/>'
        f'<parent link="{parent}"/><child link="{link.coordinate}"/>'
        f'<axis xyz="{_axis(link)}"/><limit {ends} effort="0" velocity="0"/>'
        f'<dynamics damping="{link.damping!r}" friction="0"/></joint>'
    )


class LanesEngine(RigidBodyEngine):
    """Advances one environment by floats and many by arrays."""

    guarded_strides: ClassVar[bool] = True

    @abstractmethod
    def run_lanes(self, starts: Array, count: int) -> Array:
        """Take ``count`` steps: (lanes, 3 dof) of q, v and force, finite, to (lanes, 2 dof).

        Of an engine that reports, to three columns more: iterations, residual and convergence.
        """

    def travel(
        self, ops: Ops, q: Components, v: Components, force: Components, count: int
    ) -> tuple[Components, Components, Component, Component, Component]:
        """Take ``count`` steps; q, v, and the solver's iterations, residual and convergence."""
        if not isinstance(q[0], np.ndarray):
            return super().travel(ops, q, v, force, count)
        dof = len(q)
        starts = rows_of((*q, *v, *force), len(q[0]))
        lost = ~(np.linalg.norm(starts, axis=1) < ASTRAY)
        starts[lost] = 0.0
        ends = self.run_lanes(starts, count)
        ends[lost, : 2 * dof] = np.nan
        columns = tuple(np.ascontiguousarray(ends.T))
        q, v, report = columns[:dof], columns[dof : 2 * dof], columns[2 * dof :]
        if not self.reports:
            return q, v, 0, 0.0, True
        iterations, residual, converged = report
        return q, v, iterations, residual, (converged != 0.0) & ~lost
