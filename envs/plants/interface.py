"""What every plant provides."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol

from ..ops.ops import Component, Components, Ops, join_state

MASS_DISTRIBUTIONS = ("uniform", "point")
"""Of a link: a uniform rod, or a point mass at its end."""


class Plant(Protocol):
    """A continuous-time mechanical system with controls that drive it.

    A plant is a frozen dataclass whose fields are its parameters (see
    :func:`integ_gym.support.parameters.parameter`); each may be a number or one value per lane.
    What a plant may give as well:

    - ``jacobian(ops, q, v, force) -> (∂a/∂q, ∂a/∂v)``; without it implicit integrators take finite
      differences;
    - ``stops``, a :class:`integ_gym.envs.plants.contact.Stops` or None, on the coordinate whose
      index the class attribute ``stopped`` is;
    - ``input_forces(ops, q, v, controls) -> generalized forces``, where a control is more than a
      force along one coordinate; ``jacobian`` then stays out, and the controls' work is carried
      through the integrator's stages like the losses;
    - ``contacts``, a tuple of :class:`integ_gym.envs.plants.contact.ContactPoint`, of which the
      class attribute ``contact_names`` says the names;
    - ``massless``, indices of coordinates that stand for a first-order lag of a control, or
      for a clock: they have neither mass nor energy, a generalized force on one is its acceleration
      and does no work;
    - ``probe``, a state in state order, away from rest, symmetries and contact, where plants are
      examined in free motion;
    - ``hands``, for play: what each of two hands adds to every control, in shares of its limits;
    - ``velocity_units``, where they are not those of the coordinates per second;
    - ``speed_limits``, the largest magnitude of each velocity or None, where no ``max_speed`` is
      given; or None;
    - ``dry_friction``, a :class:`integ_gym.envs.mechanics.Friction` or None;
    - ``mechanism``, a :class:`integ_gym.envs.mechanics.Mechanism`: without it, engines
      that move rigid bodies refuse the plant. Its ``massless`` coordinates are the last, and
      advance beside the engine by symplectic Euler.

    Stops, contact points and friction are forces that
    :class:`integ_gym.envs.plants.system.PlantSystem` adds to the control: ``acceleration``,
    ``energy``, ``dissipation`` and ``jacobian`` leave them out.
    """

    name: ClassVar[str]
    coordinates: ClassVar[tuple[str, ...]]
    velocities: ClassVar[tuple[str, ...]]
    coordinate_units: ClassVar[tuple[str, ...]]
    controls: ClassVar[tuple[tuple[str, str], ...]]
    """Name and unit of each control."""
    frame: ClassVar[str]
    actuated: ClassVar[tuple[int, ...]]
    """Of each control, the index of the coordinate that it drives; see ``input_forces``."""
    constant_mass_matrix: ClassVar[bool]

    def acceleration(self, ops: Ops, q: Components, v: Components, force: Components) -> Components:
        """Accelerations under a generalized force, one per coordinate; affine in the force."""

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Kinetic plus potential energy, J; zero at rest hanging."""

    def dissipation(self, ops: Ops, q: Components, v: Components) -> Component:
        """Power that damping takes out, W."""

    def mass_matrix(self, ops: Ops, q: Components) -> tuple[Components, ...]:
        """Mass matrix M(q), so that canonical momenta are p = M(q) v."""


def add_border(matrix: tuple[Components, ...], zero: Component) -> tuple[Components, ...]:
    """A square matrix with a row and a column of zeros more, as of a clock."""
    return *[(*row, zero) for row in matrix], (zero,) * (len(matrix) + 1)


def controls_of(plant: Any, given: Component | Components) -> Components:
    """One value per control of a plant or plant class, where one may be given for all."""
    return given if isinstance(given, tuple) else (given,) * len(plant.controls)


def state_names(plant: Any) -> tuple[str, ...]:
    """Names of a plant's or plant class's state, in state order."""
    return join_state(plant.coordinates, plant.velocities)


def state_units(plant: Any) -> tuple[str, ...]:
    """SI units in state order."""
    own = getattr(plant, "velocity_units", None)
    rates = tuple(f"{unit}/s" for unit in plant.coordinate_units) if own is None else own
    return join_state(plant.coordinate_units, rates)
