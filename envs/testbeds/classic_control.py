"""Gymnasium's classic control, whose discretization is an attribute of the environment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import gymnasium as gym

from ..episode.discretization import Discretization
from .gym_testbed import GymTestbed
from .interface import Applied

ENGINE: Final = "gymnasium"


@dataclass(frozen=True)
class Knobs:
    """Where an environment keeps its discretization.

    Attributes:
        step: attribute that holds the integration step, s.
        integrators: name to value of ``kind``.
        kind: attribute that holds the integrator; None where there is one alone.
    """

    step: str
    integrators: Mapping[str, str]
    kind: str | None = None


CLASSIC: Final = {
    "Acrobot-v1": Knobs("dt", {"rk4": ""}),
    "CartPole-v1": Knobs(
        "tau",
        {"explicit_euler": "euler", "symplectic_euler": "semi-implicit euler"},
        "kinematics_integrator",
    ),
    "Pendulum-v1": Knobs("dt", {"symplectic_euler": ""}),
}
"""Environment id to its knobs; the integrators by the field's names."""


class ClassicControl(GymTestbed):
    """One of Gymnasium's classic control environments, the library's own code.

    An action holds for the home's control period, in which the environment takes as many steps as
    that has. Their rewards are rates: a period pays their mean. ``IntegPendulum-v0`` and
    ``IntegCartPole-v0`` are two of them at the same discretization, with state, energy, more
    integrators and a truth.

    Args:
        env_id: its id.
        arguments: see :class:`GymTestbed`.
    """

    def __init__(self, env_id: str, **arguments: Any) -> None:
        super().__init__(**arguments)
        self.env_id = env_id
        self._knobs = CLASSIC[env_id]
        self.choices = tuple(self._knobs.integrators)
        self.registered = gym.spec(env_id)
        stock = gym.make(env_id)
        integrator, step = self._found(stock)
        self.home = Discretization(integrator, step, step, ENGINE)
        stock.close()

    def build(self, discretization: Discretization, **arguments: Any) -> gym.Env[Any, Any]:
        """The environment with its attributes set.

        Raises:
            ValueError: for a step that does not divide the control period.
        """
        made = gym.make(self.env_id, **arguments)
        inner: Any = made.unwrapped
        setattr(inner, self._knobs.step, discretization.dt)
        if self._knobs.kind is not None:
            setattr(inner, self._knobs.kind, self._knobs.integrators[discretization.integrator])
        return self.held(made, discretization, rewards="rate")

    def read(self, env: gym.Env[Any, Any]) -> Applied:
        """From the attributes."""
        return self.as_applied(*self._found(env), env)

    def _found(self, env: gym.Env[Any, Any]) -> tuple[str, float]:
        """Integrator and step, s."""
        inner, knobs = env.unwrapped, self._knobs
        kind = "" if knobs.kind is None else getattr(inner, knobs.kind)
        name = next(own for own, value in knobs.integrators.items() if value == kind)
        return name, float(getattr(inner, knobs.step))
