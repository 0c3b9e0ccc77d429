"""The environment ids, and their registration with Gymnasium.

Importing the package imports this, so that it takes no more than Gymnasium itself does.
"""

from __future__ import annotations

from typing import Final

import gymnasium as gym

ENVIRONMENTS: Final = {
    "IntegCartPole-v0": "integ_gym.envs.catalogue.cart_pole:IntegCartPole",
    "IntegCartPoleSwingUp-v0": "integ_gym.envs.catalogue.cart_pole_swing_up:IntegCartPoleSwingUp",
    "IntegElasticPendulum-v0": "integ_gym.envs.catalogue.elastic_pendulum:IntegElasticPendulum",
    "IntegPendulum-v0": "integ_gym.envs.catalogue.pendulum:IntegPendulum",
}
"""Environment id to module and common stem of its `Env` and `VectorEnv` class."""


def register_environments() -> None:
    """Register every id once; a second call changes nothing."""
    for env_id, stem in ENVIRONMENTS.items():
        if env_id not in gym.registry:
            gym.register(env_id, entry_point=f"{stem}Env", vector_entry_point=f"{stem}VectorEnv")
