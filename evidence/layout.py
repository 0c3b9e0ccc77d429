"""How the recorders keep a control instant: one row of float64 numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from integ_gym.envs.plants.interface import state_names
from integ_gym.evidence.fields import Field
from integ_gym.evidence.trace_fields import CONTACT_SOURCES, controls_of, record_fields

_INFO = (
    "time",
    "energy",
    "goal_since",
    "sensor_time",
    "actuator_work",
    "dissipated",
    "clip_loss",
    "energy_residual",
    "saturated",
    "fallback_used",
    "success",
    "solver_iterations",
)

STATUS = "solver_status_code"


class Layout:
    """Names of the entries of a row, in order.

    Row 0 of an episode is its reset and row k the result of its control step k - 1: the state,
    observation and times at the instant after that step, and what was booked during it. All
    entries fit a float64 exactly.

    Args:
        plant: plant or plant class.
        task: task or task class.
        info: what a reset gives as ``info``; tells whether the environment has contact.

    Attributes:
        fields: all columns of the records.
        info: entries taken from ``info``.
        state: entries of the true state, in state order.
        sensed: entries of the observation.
        names: all entries: ``info``, then solver status, reward, terminated and truncated, then
            ``state`` and ``sensed``.
    """

    def __init__(self, plant: Any, task: Any, info: Mapping[str, Any] | None = None) -> None:
        self.fields: tuple[Field, ...] = record_fields(plant, task)
        contact = tuple(name for name in CONTACT_SOURCES if name in (info or {}))
        controls = tuple(
            source for _, _, *sources in controls_of(plant) for source in reversed(sources)
        )
        self.info = (*_INFO, *controls, *contact)
        self.state = state_names(plant)
        self.sensed = tuple(f"sensed_{name}" for name in task.observation_names)
        booked = (STATUS, "reward", "terminated", "truncated")
        self.names = (*self.info, *booked, *self.state, *self.sensed)
        self._places = {name: place for place, name in enumerate(self.names)}

    def __len__(self) -> int:
        return len(self.names)

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def place(self, name: str) -> int:
        """Where an entry is in the row."""
        return self._places[name]

    def places(self, names: tuple[str, ...]) -> slice:
        """Where consecutive entries are in the row."""
        first = self._places[names[0]]
        return slice(first, first + len(names))
