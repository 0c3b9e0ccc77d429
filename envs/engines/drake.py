"""Steps of exactly one size under a constant generalized force, by Drake's own means."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from math import frexp, inf, ldexp, nan, pi
from typing import Any, ClassVar

import numpy as np

from integ_gym.support.optional import load

from ..mechanics import Link
from ..ops.ops import Components
from .rigid import Array, RigidBodyEngine
from .simulator import Run, is_astray

SPAN = 64
"""Steps on either side of time zero that a clock counts before it is set back."""

_BITS = 47
"""Of a step's size, so that multiples of it up to :data:`SPAN` have 53 at most."""


class Clock:
    """Lets a simulator of a continuous plant take steps of exactly one size.

    A simulator advances to a time, and a step is the difference from the last. The size is ``dt``
    to 47 bits, and times are multiples of it from -64 to 64 and again: all of them and their
    differences are exact, so that no step depends on the time at which it is taken.

    Args:
        plant: continuous.
        scheme: Drake's name of an integrator.
        dt: s.
        least_share: of a step, into which Drake may divide it before it gives up.

    Attributes:
        size: of a step, s.
        simulator: Drake's.
        integrator: Drake's.
        now: number of the last step; at :data:`SPAN` the clock has to be set back.
    """

    def __init__(self, plant: Any, scheme: str, dt: float, least_share: float = 0.0) -> None:
        analysis = load("pydrake.systems.analysis", "drake")
        mantissa, exponent = frexp(dt)
        self.size = ldexp(round(ldexp(mantissa, _BITS)), exponent - _BITS)
        self.simulator = analysis.Simulator(plant)
        self.integrator = analysis.ResetIntegratorFromFlags(self.simulator, scheme, self.size)
        self._quiet = analysis.InitializeParams(suppress_initialization_events=True)
        self._advance, self._least, self.now = self.simulator.AdvanceTo, least_share, SPAN
        self._reset()

    def forget(self) -> None:
        """Let nothing of earlier steps have a part in the next: no matrix outlives a reset."""
        self._reset()
        self.integrator.Initialize()

    def set_back(self) -> None:
        """To the earliest time, and forget."""
        self._reset()
        self.simulator.get_mutable_context().SetTime(-SPAN * self.size)
        self.simulator.Initialize(self._quiet)
        self.now = -SPAN

    def take(self, count: int) -> None:
        """Take steps, to :data:`SPAN` at most; one that fails leaves a clock to be set back."""
        self.now, aim = SPAN, self.now + count
        self._advance(aim * self.size)
        self.now = aim

    def _reset(self) -> None:
        self.integrator.Reset()
        self.integrator.set_fixed_step_mode(True)
        self.integrator.set_maximum_step_size(self.size)
        self.integrator.set_requested_minimum_step_size(self._least * self.size)


def mean_squares(states: Array) -> list[float]:
    """Of each velocity, of states at the ends of steps, shape (steps, positions and velocities)."""
    return [float(x.dot(x)) / len(x) for x in states.T[states.shape[1] // 2 :]]


def state_size(plant: Any) -> int:
    """Number of positions and velocities."""
    return 2 * int(plant.num_velocities())


def force_setter(plant: Any, context: Any) -> Callable[[Components], None]:
    """What puts a generalized force into a context."""
    port = plant.get_applied_generalized_force_input_port()
    announce = port.FixValue(context, (0.0,) * plant.num_velocities()).GetMutableData
    held = announce().get_mutable_value().get_mutable_value()

    def put(force: Components) -> None:
        announce()
        held[:] = force

    return put


def discrete_steps(plant: Any, count: int, speeds: bool = False) -> Run:
    """Updates of a discrete plant; NaN where its solver fails.

    With ``speeds``, each velocity's mean square over the ends of the updates comes last.
    """
    context, end = plant.CreateDefaultContext(), plant.AllocateDiscreteVariables()
    put, size = force_setter(plant, context), state_size(plant)
    update, state = plant.CalcForcedDiscreteVariableUpdate, end.get_value(0)  # a view
    ends, lost = np.empty((count, size)), (nan,) * (size + speeds * size // 2)

    def run(*values: float) -> tuple[float, ...]:
        put(values[size:])
        context.SetDiscreteState(0, values[:size])
        try:
            for k in range(count):
                if k:
                    context.SetDiscreteState(0, state)
                update(context, end)
                if speeds:
                    ends[k] = state
        except RuntimeError:
            return lost
        return (*state.tolist(), *(mean_squares(ends) if speeds else ()))

    return run


def explicit_steps(plant: Any, scheme: str, dt: float, count: int, speeds: bool = False) -> Run:
    """Steps of an explicit integrator, with the report of one that solves nothing.

    A state that is there is not set again. With ``speeds``, each velocity's mean square over the
    ends of the steps comes before the report.
    """
    clock = Clock(plant, scheme, dt)
    context = clock.simulator.get_mutable_context()
    put, size = force_setter(plant, context), state_size(plant)
    end = context.get_continuous_state_vector().get_value()
    ends, lost = np.empty((count, size)), (*(nan,) * (size + speeds * size // 2), 0, 0.0, True)
    there: tuple[float, ...] = ()

    def run(*values: float) -> tuple[float, ...]:
        nonlocal there
        put(values[size:])
        if values[:size] != there:
            context.SetContinuousState(values[:size])
        taken = 0
        try:
            while taken < count:
                if clock.now == SPAN:
                    clock.set_back()
                steps = 1 if speeds else min(count - taken, SPAN - clock.now)
                clock.take(steps)
                if speeds:
                    ends[taken] = end
                taken += steps
        except RuntimeError:
            there = ()
            return lost
        there = tuple(end.tolist())
        return (*there, *(mean_squares(ends) if speeds else ()), 0, 0.0, True)

    return run


ACCURACY = 1e-12
"""Target accuracy of the implicit integrators, on which their Newton iterations stop."""

_LEAST_SHARE = 1.0 / 128.0
"""Of a step, into which Drake may divide it before it gives up."""

_TRIALS = 16
"""Random states from which steps are tried, to see which matrices take fewer evaluations."""

_ITERATIONS = "integrator_num_integrator_newton_raphson_iterations"
"""Of the result itself, without those of the error estimate."""

_DIVISIONS = "integrator_num_step_shrinkages_from_substep_failures"
_FACTORIZATIONS = "integrator_num_iteration_matrix_factorizations"


def implicit_steps(stepper: Stepper, count: int, speeds: bool = False) -> Run:
    """Steps of an implicit integrator, with the most Newton iterations of any.

    A step that Drake divides is reported as not converged. From values that are astray there is no
    step, for on some of them Drake crashes. With ``speeds``, each velocity's mean square over the
    ends of the steps comes before the report.
    """
    size = stepper.size
    ends, lost = np.empty((count, size)), (*(nan,) * (size + speeds * size // 2), 0, 0.0, False)

    def run(*values: float) -> tuple[float, ...]:
        if is_astray(values):
            return lost
        state, force, most, whole = values[:size], values[size:], 0, True
        try:
            for k in range(count):
                state, iterations, divisions = stepper.step(state, force)
                if is_astray(state):
                    return lost
                if speeds:
                    ends[k] = state
                most, whole = max(most, iterations), whole and not divisions
        except RuntimeError:
            return lost
        return (*state, *(mean_squares(ends) if speeds else ()), most, 0.0, whole)

    return run


def rest_serves(plant: Any, scheme: str, dt: float, accuracy: float) -> bool:
    """Whether steps from many states take fewer evaluations with the matrices at rest."""
    size = state_size(plant)
    states = np.random.default_rng(0).uniform(-pi, pi, (_TRIALS, size)).tolist()
    spent = {True: 0, False: 0}
    for from_rest in spent:
        stepper = Stepper(plant, scheme, dt, accuracy, from_rest)
        for state in states:
            try:
                stepper.step(tuple(state), (0.0,) * (size // 2))
            except RuntimeError:
                return False
            if stepper.spoiled and from_rest:
                return False
            spent[from_rest] += stepper.evaluations
    return spent[True] < spent[False]


class Stepper:
    """Takes single steps, each of which depends on its beginning alone.

    Args:
        plant: continuous.
        scheme: Drake's name of an implicit integrator.
        dt: s.
        accuracy: on which its Newton iterations stop.
        from_rest: whether steps begin with the matrices at rest, or with none.

    Attributes:
        size: number of positions and velocities.
        spoiled: whether the last step has left other matrices than it began with.
    """

    def __init__(
        self, plant: Any, scheme: str, dt: float, accuracy: float, from_rest: bool
    ) -> None:
        self._clock = Clock(plant, scheme, dt, _LEAST_SHARE)
        self._context = self._clock.simulator.get_mutable_context()
        self._put = force_setter(plant, self._context)
        self._end = self._context.get_continuous_state_vector().get_value()
        self._integrator, self._from_rest = self._clock.integrator, from_rest
        self._integrator.set_target_accuracy(accuracy)
        self._prepare = self._integrator.ResetStatistics if from_rest else self._clock.forget
        self._statistics = self._integrator.GetStatisticsSummary
        names = [name for name, _ in self._statistics()]
        found = (_ITERATIONS, _DIVISIONS, _FACTORIZATIONS)
        self._iterations, self._divisions, self._factorizations = map(names.index, found)
        self.size = state_size(plant)
        self._at_rest = (0.0,) * self.size, (0.0,) * (self.size // 2)
        self._state: Components = ()
        self._force: Components = ()
        self.spoiled = False

    @property
    def evaluations(self) -> int:
        """Of the derivatives, in the last step."""
        return int(self._integrator.get_num_derivative_evaluations())

    def step(self, state: Components, force: Components) -> tuple[Components, int, int]:
        """The state after a step, Newton's iterations, and how often Drake divided the step.

        Parts of a step are rounded with the time at which they are taken: a step that Drake divides
        or gives up is done again at a time that is always the same.

        Raises:
            RuntimeError: where Drake gives up.
        """
        try:
            found = self._attempt_step(state, force)
            whole = not found[self._divisions][1]
        except RuntimeError:
            whole = False
        if not whole:
            self._clock.now = SPAN
            found = self._attempt_step(state, force)
        return self._state, found[self._iterations][1], found[self._divisions][1]

    def _attempt_step(self, state: Components, force: Components) -> Any:
        """Take a step; what the integrator reports of it."""
        if self._clock.now == SPAN or (self.spoiled and self._from_rest):
            self._begin()
        self._prepare()
        self._take(state, force)
        found = self._statistics()
        self.spoiled = found[self._factorizations][1] > 0
        return found

    def _begin(self) -> None:
        """Set the clock back, without matrices; make those at rest."""
        self._clock.set_back()
        if self._from_rest:
            self._take(*self._at_rest)

    def _take(self, state: Components, force: Components) -> None:
        if state != self._state:
            self._context.SetContinuousState(state)
        if force != self._force:
            self._put(force)
        self._state, self._force = (), force
        self._clock.take(1)
        self._state = tuple(self._end.tolist())


EXPLICIT = {
    "explicit_euler": "explicit_euler",
    "semi_explicit_euler": "symplectic_euler",
    "runge_kutta2": "heun",
    "runge_kutta3": "kutta3",
    "bogacki_shampine3": "bogacki_shampine3",
    "runge_kutta5": "dormand_prince5",
}
IMPLICIT = {
    "radau1": "implicit_euler",
    "radau3": "radau_iia3",
    "implicit_euler": "implicit_euler_half_steps",
    "velocity_implicit_euler": "implicit_euler_half_steps",
}
DISCRETE = {
    "tamsi": "symplectic_euler",
    "sap": "symplectic_euler_implicit_damping",
    "similar": "symplectic_euler_implicit_damping",
    "lagged": "symplectic_euler_implicit_damping",
}


CONVEX = ("sap", "similar", "lagged")
"""Discrete ones whose contact is solved by SAP."""


class DrakeEngine(RigidBodyEngine):
    """Drake's `MultibodyPlant`, in float64: continuous under an integrator, or discrete.

    A continuous plant takes fixed steps; its `implicit_euler` and `velocity_implicit_euler` return
    the two half steps of their error estimate. A discrete one is stepped by its contact solver:
    `tamsi` takes joint damping explicitly, `sap`, `similar` and `lagged` implicitly. Only discrete
    plants heed joint limits, and they alone do not report what they solve.
    """

    name: ClassVar[str] = "drake"
    package: ClassVar[str] = "drake"
    modules: ClassVar[tuple[str, ...]] = ("pydrake",)
    own_springs: ClassVar[bool] = True
    tells_speeds: ClassVar[bool] = True
    stopless: ClassVar[frozenset[str]] = frozenset({*EXPLICIT, *IMPLICIT})
    maps: ClassVar[Mapping[str, str]] = {**DISCRETE, **EXPLICIT, **IMPLICIT}
    zero_settings: ClassVar[tuple[str, ...]] = ("sap_near_rigid_threshold",)
    solver_defaults: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        **{name: {"accuracy": ACCURACY} for name in IMPLICIT},
        **{name: {"sap_near_rigid_threshold": 1.0} for name in CONVEX},
    }

    def build(self) -> None:
        """Make the model, finalized, with generalized forces as its only input.

        An implicit integrator tells its target accuracy; Drake's cap of iterations is not reported.
        """
        self.reports = self.integrator not in DISCRETE
        if self.integrator in IMPLICIT:
            self.solver_tolerance = self.settings["accuracy"]
        plants = load("pydrake.multibody.plant", "drake")
        self._plant = plant = plants.MultibodyPlant(0.0 if self.reports else self.dt)
        if not self.reports:
            approximations = plants.DiscreteContactApproximation.__members__
            chosen = approximations[f"k{self.integrator.capitalize()}"]
            plant.set_discrete_contact_approximation(chosen)
            plant.SetUseSampledOutputPorts(False)
        if self.integrator in CONVEX:
            plant.set_sap_near_rigid_threshold(self.settings["sap_near_rigid_threshold"])
            self.settings = {"sap_near_rigid_threshold": plant.get_sap_near_rigid_threshold()}
        parent = plant.world_frame()
        for link, offset in zip(self.mechanism.links, self.mechanism.offsets, strict=True):
            parent = hang_link(plant, parent, link, offset)
        plant.mutable_gravity_field().set_gravity_vector((0.0, 0.0, -self.mechanism.gravity))
        plant.Finalize()

    def stop_parameters(self) -> dict[str, Any]:
        """What its law is made of; stiffness and damping follow from the step and the masses."""
        solver = self._plant.get_discrete_contact_solver().name
        known = {"discrete_contact_solver": solver, "time_step": self._plant.time_step()}
        return {**known, **self.settings}

    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """Mass matrix and generalized force of gravity."""
        plant, context = self._plant, self._plant.CreateDefaultContext()
        plant.SetPositions(context, q)
        gravity = plant.CalcGravityGeneralizedForces(context)
        return np.array(plant.CalcMassMatrix(context)), np.array(gravity)

    def forward_dynamics(self, q: Components, v: Components, force: Components) -> Array:
        """By inverse dynamics at rest and the mass matrix, which discrete plants have as well.

        Drake's joint limits are left out.
        """
        tree = load("pydrake.multibody.tree", "drake")
        plant, context = self._plant, self._plant.CreateDefaultContext()
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        inner = tree.MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, inner)
        held = plant.CalcInverseDynamics(context, np.zeros(len(v)), inner)
        return np.linalg.solve(plant.CalcMassMatrix(context), np.array(force) - held)

    def run_with_speeds(self, count: int) -> Run:
        """Take ``count`` steps and note the velocities of each."""
        return self.run(count, speeds=True)

    def run(self, count: int, speeds: bool = False) -> Run:
        """Take ``count`` steps."""
        if self.integrator in DISCRETE:
            return discrete_steps(self._plant, count, speeds)
        chosen = self._plant, self.integrator, self.dt
        if self.integrator in IMPLICIT:
            stepper = Stepper(*chosen, self.settings["accuracy"], self._from_rest)
            return implicit_steps(stepper, count, speeds)
        return explicit_steps(*chosen, count, speeds)

    @cached_property
    def _from_rest(self) -> bool:
        return rest_serves(self._plant, self.integrator, self.dt, self.settings["accuracy"])


def hang_link(plant: Any, parent: Any, link: Link, offset: float) -> Any:
    """Hang a link on a frame, so far along its z axis; its own frame."""
    tree = load("pydrake.multibody.tree", "drake")
    if offset:
        place = load("pydrake.math", "drake").RigidTransform((0.0, 0.0, offset))
        parent = plant.AddFrame(tree.FixedOffsetFrame(f"{link.coordinate}_joint", parent, place))
    inertia = tree.RotationalInertia(link.inertia, link.inertia, link.inertia)
    body = plant.AddRigidBody(
        link.coordinate,
        tree.SpatialInertia.MakeFromCentralInertia(link.mass, (0.0, 0.0, link.centre), inertia),
    )
    slides = link.joint == "slide"
    kind = tree.PrismaticJoint if slides else tree.RevoluteJoint
    limit = inf if link.limit is None else link.limit
    frame = body.body_frame()
    joint = plant.AddJoint(
        kind(link.coordinate, parent, frame, link.axis, -limit, limit, link.damping)
    )
    if link.stiffness:
        spring = tree.PrismaticSpring if slides else tree.RevoluteSpring
        plant.AddForceElement(spring(joint, link.slack, link.stiffness))
    return frame
