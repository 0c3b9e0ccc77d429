"""``IntegPendulum-v0``: torque-limited pendulum swing-up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from integ_gym.envs.environment import IntegEnv
from integ_gym.envs.vector import IntegVectorEnv


class IntegPendulumEnv(IntegEnv):
    task_name: ClassVar[str] = "pendulum_swing_up"
    defaults: ClassVar[Mapping[str, Any]] = {"integrator": "symplectic_euler", "dt": 0.05}


class IntegPendulumVectorEnv(IntegVectorEnv):
    """Vector form of :class:`IntegPendulumEnv`; see :class:`IntegVectorEnv` for its arguments."""

    env_class = IntegPendulumEnv
