"""How the recorders keep a control instant: one row of float64 numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import nan
from operator import itemgetter
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs.plants.interface import state_names

from ..schema.fields import Field
from ..schema.trace_fields import CONTACT_TRACE, record_fields

Array = npt.NDArray[Any]

STATUS = "solver_status"
"""The solver's status, as a code."""

_ENDING = ("reward", "terminated", "truncated")

_FOR_SUMMARIES = ("goal_since", "saturated", "fallback_used", "success")
"""What is taken from ``info`` beside what trace columns are made of."""

_PERHAPS_UNKNOWN = dict.fromkeys(("dissipated", "energy_residual"), nan)
"""What an environment leaves out of `info` where it is not known."""

_STARTING = ("energy", "goal_since")
"""What of ``info`` is not 0 at a reset."""


class Layout:
    """Entries of a row, in order.

    Row 0 of an episode is its reset and row k the result of its control step k - 1: the state,
    observation and times at the instant after that step, and what was booked during it. All
    entries fit a float64 exactly.

    Args:
        plant: plant or plant class.
        task: task or task class.
        info: what a reset gives as ``info``; tells whether the environment has contact.

    Attributes:
        fields: all columns of the records.
        info: entries taken from ``info``: what the trace columns and the summaries need.
        state: entries of the true state, in state order.
        names: all entries: ``info``, then solver status, reward, terminated and truncated, then
            ``state`` and the observation.
    """

    def __init__(self, plant: Any, task: Any, info: Mapping[str, Any] | None = None) -> None:
        self.fields: tuple[Field, ...] = record_fields(plant, task)
        self.state = state_names(plant)
        sensed = tuple(f"sensed_{name}" for name in task.observation_names)
        others = (STATUS, *_ENDING, *self.state, *sensed)
        absent = {field.source for field in CONTACT_TRACE} - set(info or ())
        sources = (field.source for field in self.fields if field.at)
        told = dict.fromkeys((*sources, *_FOR_SUMMARIES))
        self.info = tuple(name for name in told if name not in (*others, *absent))
        self.names = (*self.info, *others)
        self._places = {name: place for place, name in enumerate(self.names)}
        self._starting = [self._places[name] for name in (*_STARTING, *self.state, *sensed)]
        self._told = itemgetter(*self.info)

    def __len__(self) -> int:
        return len(self.names)

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def place(self, name: str) -> int:
        """Where an entry is in the row."""
        return self._places[name]

    def row(
        self,
        info: Mapping[str, Any],
        status: Any,
        ending: tuple[Any, Any, Any],
        state: Iterable[Any],
        sensed: Iterable[Any],
    ) -> tuple[Any, ...]:
        """The entries of a row: numbers, or arrays of many rows.

        Args:
            info: of the environment.
            status: code of the solver's status.
            ending: reward, terminated, truncated.
            state: true state, component by component, in state order.
            sensed: observation, component by component.
        """
        try:
            told = self._told(info)
        except KeyError:
            told = self._told({**_PERHAPS_UNKNOWN, **info})
        return (*told, status, *ending, *state, *sensed)

    def start(
        self, info: Mapping[str, Any], state: Iterable[Any], sensed: Iterable[Any]
    ) -> tuple[Any, ...]:
        """The entries of a reset's row that are not 0, as :meth:`row`; of the status see there."""
        return (*(info[name] for name in _STARTING), *state, *sensed)

    def start_rows(self, entries: Array, status: int | Array) -> Array:
        """Whole rows of resets.

        Args:
            entries: see :meth:`start`, shape (entries, resets).
            status: code of the solver's status where no step has been taken, one or of each.

        Returns:
            Shape (all entries, resets).
        """
        rows = np.zeros((len(self), entries.shape[1]))
        rows[self._starting] = entries
        rows[self._places[STATUS]] = status
        return rows
