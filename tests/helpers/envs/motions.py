"""Plants and free motions that several tests follow, on the native engine."""

from __future__ import annotations

import numpy as np

from integ_gym.envs.registries import INTEGRATORS, PLANTS

ALL = INTEGRATORS.names()
DAMPED: dict[str, dict[str, float]] = {
    "acrobot": {"damping": 0.1},
    "chain": {"damping": 0.1},
    "pendulum": {"damping": 0.3},
    "cart_pole": {"damping": 0.02, "cart_damping": 0.4},
    "elastic_pendulum": {"damping": 0.2, "stiffness": 50.0},
    "reacher": {"damping": 0.1},
}
DRIVEN_PLANTS = {name: PLANTS.load(name)(**DAMPED.get(name, {})) for name in PLANTS.names()}
UNLIMITED: dict[str, dict[str, None]] = {
    "IntegAcrobot-v0": {"max_speed_1": None, "max_speed_2": None}
}
"""What lifts the limits on speeds that an environment has by default."""
STARTS = {
    name: ((0.3,) * len(plant.coordinates), (1.0,) * len(plant.coordinates))
    for name, plant in DRIVEN_PLANTS.items()
} | {
    "pendulum": ((2.0,), (1.5,)),
    "cart_pole": ((0.1, 2.0), (0.3, 3.0)),
    "elastic_pendulum": ((0.3, 0.1), (1.0, -0.5)),
    "hopper": ((0.0, 3.0, 0.1, 0.3, 0.5), (1.0, 1.0, 0.5, -1.0, 0.5)),
}


def draw_configuration(plant, rng, *lanes):
    """Normal about zero, or close about a plant's `probe`, shape (n, *lanes)."""
    q = rng.normal(0.0, 1.0, (len(plant.coordinates), *lanes))
    if not hasattr(plant, "probe"):
        return q
    return np.array(plant.probe)[0::2].reshape(-1, *(1,) * len(lanes)) + 0.1 * q
