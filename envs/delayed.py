"""Late commands and observations in environments of others."""

from __future__ import annotations

from collections import deque
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from .ops.ops import SCALAR
from .settings import Timing
from .starts import ARRIVAL, stream_of_episode
from .tasks.interface import Command
from .transition import draw_arrival

NOT_LATE = (1.0, 0.0)
"""In place of numbers that are drawn: the command arrives, and no later than all do."""


class CommandQueue:
    """Commands on their way, of which the newest that has arrived acts.

    What is drawn comes from a stream of each episode's own, by the seed, as in integ-gym's own
    environments.

    Args:
        timing: rates and delays.
        idle: acts until the first command arrives.

    Attributes:
        info: what became of the last command, where that is drawn; else empty.
    """

    def __init__(self, timing: Timing, idle: Any) -> None:
        self._timing, self._idle = timing, idle
        self._seeded: np.random.Generator | None = None
        self._episode = 0
        self.info: dict[str, Any] = {}

    def begin(self, seed: int | None) -> None:
        """Start an episode with nothing under way.

        Args:
            seed: that the environment is given; None: of the episode before.
        """
        if seed is not None or self._seeded is None:
            self._seeded, self._episode = np.random.default_rng(seed), 0
        else:
            self._episode += 1
        self._stream = stream_of_episode(self._seeded, ARRIVAL, self._episode)
        memory = self._timing.memory
        self._commands = ((self._idle,),) * (memory + 1)
        self._arrivals = (0.0,) * memory
        self.info = {"command_held": False, "command_latency": 0.0} if self._timing.drawn else {}

    def give(self, command: Any) -> list[tuple[Any, int]]:
        """The commands that act in a control period, and for how many steps each, oldest first.

        Args:
            command: what is decided at its beginning.
        """
        timing = self._timing
        numbers = tuple(self._stream.random(2).tolist()) if timing.drawn else NOT_LATE
        commands = ((command,), *self._commands)
        under_way = commands, (False,) * len(commands), self._arrivals
        asked = Command((command,), True, False)
        orders = draw_arrival(SCALAR, timing, under_way, asked, None, numbers)
        self._commands, self._arrivals = orders.commands, orders.arrivals
        if timing.drawn:
            self.info = {"command_held": orders.held, "command_latency": orders.latency}
        return [(acting, int(steps)) for (acting,), steps in orders.acting if steps]


class Delayed(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Actions act, and observations are shown, some steps later.

    Until the first action arrives the one nearest to 0 acts; until the first observation does, that
    of the start is shown.

    Args:
        env: whose steps are counted.
        timing: delays in these steps.

    Attributes:
        acting: the action of the last step.
    """

    def __init__(self, env: gym.Env[Any, Any], timing: Timing) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, timing=timing)
        super().__init__(env)
        space: Any = env.action_space
        self._idle = (
            min(max(0, int(space.start)), int(space.start + space.n) - 1)
            if isinstance(space, spaces.Discrete)
            else np.clip(np.zeros(space.shape, space.dtype), space.low, space.high)
        )
        self._queue = CommandQueue(timing, self._idle)
        periods, rest = timing.sight
        self._late = periods * timing.substeps + rest

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode with nothing under way."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._queue.begin(seed)
        self.acting, self._coming = self._idle, deque[Any]()
        self._seen = deque([np.copy(observation)] * self._late)
        return observation, {**info, **self._queue.info}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take the action that has arrived, and show the observation that has."""
        if not self._coming:
            acting = self._queue.give(action)
            self._coming.extend(one for one, steps in acting for _ in range(steps))
        self.acting = self._coming.popleft()
        return self._take()

    def _take(self) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take a step of the environment, and show the observation that has arrived."""
        observation, reward, terminated, truncated, info = self.env.step(self.acting)
        self._seen.append(np.copy(observation))
        info = {**info, **self._queue.info}
        return self._seen.popleft(), float(reward), terminated, truncated, info


class SplitDelayed(Delayed):
    """The same of decisions whose integration steps an environment takes by itself.

    Commands act by these steps, observations are shown by decisions.

    Args:
        env: whose steps are decisions; it has ``earlier``: the actions that act in the next one
            before its own, oldest first, None for the one that acts already, and for how many
            integration steps each does.
        timing: delays in integration steps.
    """

    def __init__(self, env: gym.Env[Any, Any], timing: Timing) -> None:
        super().__init__(env, timing)
        self._late = timing.sight[0]

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take a decision, in which the actions act that have arrived."""
        *before, (last, _) = self._queue.give(action)
        earlier = [(None if one is self.acting else one, steps) for one, steps in before]
        self.env.unwrapped.earlier, self.acting = earlier, last  # type: ignore[attr-defined]
        return self._take()
