"""``IntegCartPole-v0``: cart-pole balance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from integ_gym.envs.environment import IntegEnv
from integ_gym.envs.vector import IntegVectorEnv


class IntegCartPoleEnv(IntegEnv):
    task_name: ClassVar[str] = "cart_pole_balance"
    defaults: ClassVar[Mapping[str, Any]] = {"integrator": "explicit_euler", "dt": 0.02}


class IntegCartPoleVectorEnv(IntegVectorEnv):
    """Vector form of :class:`IntegCartPoleEnv`; see :class:`IntegVectorEnv` for its arguments."""

    env_class = IntegCartPoleEnv
