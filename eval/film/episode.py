"""One episode of a film: what moves in it, and where its energy came from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from integ_gym.envs.catalogue.lookup import environment_setup
from integ_gym.envs.plants.interface import state_names
from integ_gym.envs.rendering.cockpit import Moment
from integ_gym.envs.settings import Discretization, Setup
from integ_gym.envs.transition import LOSSES
from integ_gym.evidence.record import EvidenceRecord
from integ_gym.train.policy import Policy

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Episode:
    """An episode at its control instants.

    Attributes:
        setup: of its environment.
        times: since the start, s, shape (steps + 1,).
        states: true states, SI units, shape (steps + 1, n).
        controls: applied in the step that ends there, shape (steps + 1,); 0 at the start.
        energy: of the plant, J, shape (steps + 1,).
        work: of the motor until then, J, shape (steps + 1,).
        numerics: energy that numerical error put in until then, J; NaN where it is not known.
        losses: energy that damping, contact and the speed limit took out until then, J.
        success: whether it succeeds.
    """

    setup: Setup
    times: Array
    states: Array
    controls: Array
    energy: Array
    work: Array
    numerics: Array
    losses: Array
    success: bool

    @property
    def discretization(self) -> Discretization:
        """What it runs on."""
        return Discretization.of(self.setup)

    def ledger(self) -> dict[str, Array]:
        """Amounts of energy, J, shape (steps + 1,), the last of which is the sum of the others."""
        return {
            "start": np.full_like(self.energy, self.energy[0]),
            "motor": self.work,
            "numerics": self.numerics,
            "losses": -self.losses,
            "energy": self.energy,
        }

    def moment(self, time: float, shown: Iterable[str]) -> Moment:
        """What a film shows at a time; its end, where it has ended.

        Args:
            time: since the start, s.
            shown: names of the amounts of energy that are.
        """
        place = int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1
        ledger = self.ledger()
        bars = {name: float(ledger[name][place]) for name in shown}
        return Moment(self.states[place], float(self.controls[place]), bars)


def played(
    policy: Policy, env_id: str, arguments: Mapping[str, Any], seed: int | None, start: Any = None
) -> Episode:
    """A policy's episode in an environment.

    Args:
        policy: what acts.
        env_id: one of integ-gym's environments.
        arguments: of the environment.
        seed: of its reset.
        start: state to start from, shape (n,), SI units; None: the seed draws it.

    Raises:
        TypeError, ValueError: for arguments that cannot be.
    """
    env = gym.make(env_id, disable_env_checker=True, **arguments)
    own: Any = env.unwrapped
    observation, info = env.reset(seed=seed)
    if start is not None and not np.array_equal(own.state, start):
        observation, info = env.reset(seed=seed, options={"state": tuple(start)})
    states, told, ended = [own.state], [info], False
    while not ended:
        action = policy.act(observation[None])[0].reshape(env.action_space.shape)
        observation, _, terminated, truncated, info = env.step(action)
        states.append(own.state)
        told.append(info)
        ended = terminated or truncated
    env.close()
    steps = {name: _column(told, name) for name in ("time", "control", "energy")}
    return Episode(
        own.setup,
        steps["time"],
        np.array(states),
        steps["control"],
        steps["energy"],
        np.cumsum(_column(told, "actuator_work")),
        np.cumsum(_column(told, "energy_residual")),
        sum((np.cumsum(_column(told, name)) for name in LOSSES), np.zeros(len(told))),
        bool(info["success"]),
    )


def recorded(record: EvidenceRecord) -> Episode:
    """The episode of a record that has a trace.

    Raises:
        TypeError, ValueError: for arguments that cannot be any more.
    """
    setup = environment_setup(record["env_id"], record.arguments())
    trace = record.trace
    steps = len(trace["time"])

    def total(name: str) -> Array:
        return np.concatenate([[0.0], np.cumsum(trace[name])]) if name in trace else np.zeros(steps)

    return Episode(
        setup,
        trace["time"],
        np.stack([trace[name] for name in state_names(setup.plant)], axis=1),
        np.concatenate([[0.0], trace[f"{setup.plant.control_name}_applied"]]),
        trace["energy"],
        total("work"),
        total("energy_residual") if "energy_residual" in trace else np.full(steps, np.nan),
        sum((total(name) for name in LOSSES), np.zeros(steps)),
        bool(record["success"]),
    )


def _column(told: list[dict[str, Any]], name: str) -> Array:
    """An entry of ``info`` over an episode; NaN where it is not known."""
    values = [info.get(name) for info in told]
    return np.array([np.nan if value is None else float(value) for value in values])
