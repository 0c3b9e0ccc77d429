"""The plant as an integrator sees it: forces assembled, losses and speed limit attached."""

from __future__ import annotations

from integ_gym.envs.ops import Component, Components, Ops
from integ_gym.envs.plants.interface import Plant


class PlantSystem:
    """A plant at a constant control, with an optional limit on its speeds.

    Args:
        plant: the continuous-time plant.
        max_speed: largest magnitude of each velocity component, rad/s or m/s, or None.
    """

    def __init__(self, plant: Plant, max_speed: Component | None = None) -> None:
        self.plant = plant
        self.max_speed = max_speed
        self._before = (0.0,) * plant.actuated
        self._after = (0.0,) * (len(plant.coordinates) - plant.actuated - 1)
        self._jacobian = getattr(plant, "jacobian", None)

    def rates(
        self, ops: Ops, q: Components, v: Components, control: Component
    ) -> tuple[Components, Components]:
        """Accelerations and (damping power,) in W."""
        force = (*self._before, control, *self._after)
        plant = self.plant
        return plant.acceleration(ops, q, v, force), (plant.dissipation(ops, q, v),)

    def slopes(
        self, ops: Ops, q: Components, v: Components, control: Component
    ) -> tuple[tuple[Components, ...], tuple[Components, ...]] | None:
        """The plant's (∂a/∂q, ∂a/∂v), or None."""
        if self._jacobian is None:
            return None
        force = (*self._before, control, *self._after)
        return self._jacobian(ops, q, v, force)  # type: ignore[no-any-return]

    def limit(self, ops: Ops, v: Components) -> Components:
        """``v`` with each component within ±max_speed."""
        if self.max_speed is None:
            return v
        return tuple([ops.maximum(-self.max_speed, ops.minimum(x, self.max_speed)) for x in v])

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Energy of the plant, J."""
        return self.plant.energy(ops, q, v)
