"""A hand-made controller that swings the cart-pole up in every engine as its users get it.

It does not know the engine. Below, the cart is accelerated so that the pole gains energy and the
cart stays near the middle; the pole gets more energy than standing upright has, for friction takes
some of it. Near the top a linear regulator takes over. Its numbers were chosen on the starts of
seed 900.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TOTAL_MASS = 1.1
"""Of the default cart and pole, kg."""

UPRIGHT_ENERGY = 0.49
"""Of the default pole at rest upright, J; it is zero with the pole horizontal."""

SQUARED_RATE_PER_JOULE = 60.0
"""Of the default pole about its hinge: its squared rate over its kinetic energy, 1/(kg m²)."""

WANTED_ENERGY = 0.75
"""To which the pole is pumped, J."""

PUMPING_GAIN = 29.4
"""Acceleration of the cart for each J that the pole lacks, 1/(kg m)."""

MAX_PUMPING = 11.0
"""Largest such acceleration, m/s²."""

CENTRING_STIFFNESS, CENTRING_DAMPING = 1.96, 2.8
"""Of the cart while it pumps: acceleration towards the middle, 1/s², and against its speed, 1/s."""

POSITION_GAIN, SPEED_GAIN, ANGLE_GAIN, RATE_GAIN = 6.1, 8.3, 66.0, 17.0
"""Of the regulator: N/m, N s/m, N/rad and N s/rad."""

CATCH_ANGLE = 0.6
"""Within which of upright the regulator takes over, rad."""

CATCH_RATE = 2.0
"""Within which of the rate that just brings a free pole upright it does, rad/s."""

ARRIVAL_RATE = 3.8
"""That rate for each rad from upright, 1/s."""

MAX_FORCE = 10.0
"""N."""


def swing_up(observations: NDArray[np.float32]) -> NDArray[np.float32]:
    """Forces in N.

    Args:
        observations: of `IntegCartPoleSwingUp-v0`, shape (n, 5).

    Returns:
        Shape (n, 1).
    """
    x, x_dot, cosine, sine, rate = observations.astype(np.float64).T
    angle = np.arctan2(sine, cosine)
    energy = rate**2 / SQUARED_RATE_PER_JOULE + UPRIGHT_ENERGY * cosine
    pumping = np.clip(PUMPING_GAIN * (WANTED_ENERGY - energy), -MAX_PUMPING, MAX_PUMPING)
    acceleration = pumping * -np.copysign(1.0, rate * cosine)
    acceleration -= CENTRING_STIFFNESS * x + CENTRING_DAMPING * x_dot
    regulated = POSITION_GAIN * x + SPEED_GAIN * x_dot + ANGLE_GAIN * angle + RATE_GAIN * rate
    near = (abs(angle) < CATCH_ANGLE) & (abs(rate + ARRIVAL_RATE * angle) < CATCH_RATE)
    force = np.where(near, regulated, TOTAL_MASS * acceleration)
    return np.clip(force, -MAX_FORCE, MAX_FORCE).astype(np.float32)[:, None]
