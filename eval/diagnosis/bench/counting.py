"""An engine that counts what an integrator asks of the plant."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

from integ_gym.envs.engines.native import NativeEngine
from integ_gym.envs.environment import IntegEnv
from integ_gym.envs.mechanics import PlantSystem


class CountingSystem(PlantSystem):
    """A system that counts how often it is asked for accelerations or a Jacobian."""

    evaluations = 0

    def rates(self, *arguments: Any) -> Any:
        self.evaluations += 1
        return super().rates(*arguments)

    def slopes(self, *arguments: Any) -> Any:
        given = super().slopes(*arguments)
        self.evaluations += given is not None
        return given


class CountingEngine(NativeEngine):
    """The native engine, called step by step: a traced step would be counted once."""

    batched: ClassVar[bool] = False


def counted(env: IntegEnv) -> CountingSystem:
    """Put a counting engine into an environment; the motion stays the same bit by bit."""
    setup = env.setup
    stopped = setup.system.engine_stops is not None
    system = CountingSystem(setup.plant, setup.system.max_speed, stopped)
    engine = CountingEngine(system, setup.settings.integrator, setup.settings.dt)
    env.setup = replace(setup, engine=engine)
    return system
