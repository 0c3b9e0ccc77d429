"""Hand-made controllers that swing the cart-pole up in engines as their users get them.

They show that a task can be done. None is given the engine or the truth. Below, the cart is
accelerated so that the pole gains energy and the cart stays near the middle; the pole gets more
energy than standing upright has, for friction takes some of it. Near the top a linear regulator
takes over. All numbers were chosen on the starts of seed 900: those of the default track by hand,
those of the short track by random search, in the native engine with and without Bullet's damping,
and for PhysX in SAPIEN.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TOTAL_MASS = 1.1
"""Of the default cart and pole, kg."""

UPRIGHT_ENERGY = 0.49
"""Of the default pole at rest upright, J; it is zero with the pole horizontal."""

SQUARED_RATE_PER_JOULE = 60.0
"""Of the default pole about its hinge: its squared rate over its kinetic energy, 1/(kg m²)."""

MAX_FORCE = 10.0
"""N."""


@dataclass(frozen=True)
class SwingUp:
    """A controller's numbers.

    Attributes:
        wanted_energy: to which the pole is pumped, J.
        pumping_gain: acceleration of the cart for each J that the pole lacks, 1/(kg m).
        max_pumping: largest such acceleration, m/s².
        centring_stiffness: of the cart while it pumps, towards the middle, 1/s².
        centring_damping: of the cart while it pumps, against its speed, 1/s.
        position_gain: of the regulator, N/m.
        speed_gain: of the regulator, N s/m.
        angle_gain: of the regulator, N/rad.
        rate_gain: of the regulator, N s/rad.
        catch_angle: within which of upright the regulator takes over, rad.
        catch_rate: within which of the rate that just brings the pole upright it does, rad/s.
        arrival_rate: that rate for each rad from upright, 1/s.
    """

    wanted_energy: float
    pumping_gain: float
    max_pumping: float
    centring_stiffness: float
    centring_damping: float
    position_gain: float
    speed_gain: float
    angle_gain: float
    rate_gain: float
    catch_angle: float
    catch_rate: float
    arrival_rate: float

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Forces in N.

        Args:
            observations: of `IntegCartPoleSwingUp-v0`, shape (n, 5).

        Returns:
            Shape (n, 1).
        """
        x, x_dot, cosine, sine, rate = observations.astype(np.float64).T
        angle = np.arctan2(sine, cosine)
        energy = rate**2 / SQUARED_RATE_PER_JOULE + UPRIGHT_ENERGY * cosine
        pumping = self.pumping_gain * (self.wanted_energy - energy)
        pumping = np.clip(pumping, -self.max_pumping, self.max_pumping)
        acceleration = pumping * -np.copysign(1.0, rate * cosine)
        acceleration -= self.centring_stiffness * x + self.centring_damping * x_dot
        of_cart = self.position_gain * x + self.speed_gain * x_dot
        regulated = of_cart + self.angle_gain * angle + self.rate_gain * rate
        arrives = abs(rate + self.arrival_rate * angle) < self.catch_rate
        near = (abs(angle) < self.catch_angle) & arrives
        force = np.where(near, regulated, TOTAL_MASS * acceleration)
        return np.clip(force, -MAX_FORCE, MAX_FORCE).astype(np.float32)[:, None]


DEFAULT_TRACK = SwingUp(
    wanted_energy=0.75, pumping_gain=29.4, max_pumping=11.0,
    centring_stiffness=1.96, centring_damping=2.8,
    position_gain=6.1, speed_gain=8.3, angle_gain=66.0, rate_gain=17.0,
    catch_angle=0.6, catch_rate=2.0, arrival_rate=3.8,
)  # fmt: skip
"""In every engine."""

SHORT_TRACK = SwingUp(
    wanted_energy=0.76, pumping_gain=29.0, max_pumping=8.8,
    centring_stiffness=16.0, centring_damping=1.7,
    position_gain=5.9, speed_gain=9.3, angle_gain=65.0, rate_gain=15.0,
    catch_angle=0.56, catch_rate=3.7, arrival_rate=6.1,
)  # fmt: skip
"""Of 0.6 m to either side, in every engine but SAPIEN."""

SHORT_TRACK_IN_PHYSX = SwingUp(
    wanted_energy=0.82, pumping_gain=34.0, max_pumping=9.2,
    centring_stiffness=9.5, centring_damping=3.8,
    position_gain=10.0, speed_gain=10.0, angle_gain=69.0, rate_gain=14.0,
    catch_angle=0.3, catch_rate=4.2, arrival_rate=13.7,
)  # fmt: skip
"""The same in SAPIEN; from about half of all starts."""
