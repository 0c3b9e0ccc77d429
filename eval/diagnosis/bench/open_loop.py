"""A plant without a task: given starts, given commands, followed to the end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import make_dataclass
from functools import cache
from typing import Any, ClassVar

from integ_gym.envs.environment import IntegEnv
from integ_gym.envs.ops.ops import Component, Components, Ops
from integ_gym.envs.plants.interface import join_state, state_names, state_units
from integ_gym.envs.registries import PLANTS
from integ_gym.envs.tasks.interface import BoxTask
from integ_gym.envs.vector import IntegVectorEnv
from integ_gym.support.parameters import parameter, positive


class OpenLoop(BoxTask):
    """No reward and no termination; success is to arrive at the end without diverging.

    Made a dataclass for one plant by :func:`open_loop_environment`, which adds the field
    ``control_limit`` in the plant's unit.
    """

    plant: ClassVar[str]
    observation_names: ClassVar[tuple[str, ...]]
    observation_units: ClassVar[tuple[str, ...]]
    starts: ClassVar[tuple[str, ...]] = ("given",)
    start_options: ClassVar[tuple[str, ...]] = ()
    goal: ClassVar[str] = "no divergence until `duration`"
    goal_stay: ClassVar[float] = 0.0

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """Unbounded."""
        return (float("inf"),) * len(self.observation_names)

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """The state in state order."""
        return join_state(q, v)

    def reward(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        mean_square_control: Component,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """Nothing."""
        return 0.0 * q[0]

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Wherever it is."""
        return q[0] == q[0]

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """Any state: starts are given, and this one follows an episode that has ended."""
        return (1.0, 0.0) * (len(self.observation_names) // 2)


@cache
def open_loop_environment(plant: str) -> type[IntegVectorEnv]:
    """The vector environment of a plant without a task; its ``env_class`` is the single one.

    Args:
        plant: a registered name or ``"module:Class"``.

    Raises:
        ValueError: for a plant that is neither.
    """
    plant_class = PLANTS.load(plant)
    described = {
        "plant": plant,
        "observation_names": state_names(plant_class),
        "observation_units": state_units(plant_class),
    }
    limit = parameter(1e6, plant_class.control_unit, "saturation of the actuator", positive)
    task = make_dataclass(
        "OpenLoop", [("control_limit", float, limit)], bases=(OpenLoop,), namespace=described,
        frozen=True,
    )  # fmt: skip
    name = f"OpenLoop-{plant_class.name}"
    own = {"task_class": classmethod(lambda cls: task), "defaults": {"integrator": "rk4"}}
    return type(name, (IntegVectorEnv,), {"env_class": type(name, (IntegEnv,), own)})
