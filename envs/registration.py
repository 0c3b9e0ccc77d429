"""Registration of the environment ids with Gymnasium."""

from __future__ import annotations

import gymnasium as gym

ENVIRONMENTS = {
    "IntegPendulum-v0": "integ_gym.envs.pendulum:IntegPendulum",
    "IntegCartPole-v0": "integ_gym.envs.cart_pole:IntegCartPole",
}
"""Environment id to module and common stem of its `Env` and `VectorEnv` class."""


def register_environments() -> None:
    """Register every id once; a second call changes nothing."""
    for env_id, stem in ENVIRONMENTS.items():
        if env_id not in gym.registry:
            gym.register(env_id, entry_point=f"{stem}Env", vector_entry_point=f"{stem}VectorEnv")
