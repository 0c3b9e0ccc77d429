"""Plants and free motions that several tests follow, on the native engine."""

from __future__ import annotations

from typing import Any

import numpy as np

from integ_gym.envs.engines.native import NativeEngine
from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.envs.ops import SCALAR
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.system import PlantSystem

ALL = INTEGRATORS.names()
DRIVEN_PLANTS = {
    "pendulum": Pendulum(damping=0.3),
    "cart_pole": CartPole(damping=0.02, cart_damping=0.4),
}
STARTS = {"pendulum": ((2.0,), (1.5,)), "cart_pole": ((0.1, 2.0), (0.3, 3.0))}


def energies(plant: Any, integrator: str, dt: float, steps: int, q: Any, v: Any) -> np.ndarray:
    """Energy after each step of a free motion, shape (steps + 1,), J."""
    engine = NativeEngine(PlantSystem(plant), integrator, dt)
    trace = [plant.energy(SCALAR, q, v)]
    for _ in range(steps):
        motion = engine.advance(SCALAR, q, v, ((0.0, 1),), None)
        q, v = motion.q, motion.v
        trace.append(plant.energy(SCALAR, q, v))
    return np.array(trace)
