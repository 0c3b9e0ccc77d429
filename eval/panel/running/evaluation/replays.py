"""What episodes of other cells say about the failures in a cell."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs.settings import Discretization, Settings
from integ_gym.evidence.labels import Home as HomeReplay
from integ_gym.evidence.labels import Replays

from ...cells import Cell, Home

Flags = npt.NDArray[np.bool_]
Key = tuple[Discretization, str | None]

_DISTURBANCES = {
    "without_noise": {"observation_noise"},
    "without_delay": {"action_latency", "sensor_period"},
}
"""Replays to the arguments that they do without."""


class Successes:
    """Which episodes succeeded, policy by policy and cell by cell.

    Args:
        homes: training discretization or mixture of every policy, or None.
        cells: cells that every policy is evaluated in.
        environment: constructor arguments common to all cells.
        first: index of the first episode of every cell.
        statuses: whether a cell can be solved, by its name; see
            :data:`integ_gym.evidence.fields.CELL_STATUSES`.
        whole: whether every policy's episodes at home are all here, so that its success there is
            known.
        homeless: policies that were trained nobody says where.
        before: of every policy, of how many of how many earlier episodes at home it succeeded, by
            cell.
    """

    def __init__(
        self,
        homes: Sequence[Home | None],
        cells: Sequence[Sequence[Cell]],
        environment: Mapping[str, Any],
        first: int = 0,
        statuses: Mapping[str, str] | None = None,
        whole: bool = True,
        homeless: Collection[int] = (),
        before: Sequence[Mapping[str, tuple[int, int]]] = (),
    ) -> None:
        self._homes = homes
        self._environment = environment
        self._first = first
        self._statuses = statuses or {}
        self._whole = whole
        self._homeless = homeless
        self._before = before
        self._awaited = [{_key(cell) for cell in own} for own in cells]
        self._known: dict[tuple[int, Key], Flags] = {}
        self._recovered: dict[tuple[int, Key], Flags | None] = {}

    def note(
        self, cell: Cell, policies: Sequence[int], success: Flags, recovered: Flags | None
    ) -> None:
        """Take in a cell's outcomes, shape (policies, episodes), within one horizon and two."""
        for i, place in enumerate(policies):
            self._known[place, _key(cell)] = success[i]
            self._recovered[place, _key(cell)] = None if recovered is None else recovered[i]
            self._awaited[place].discard(_key(cell))

    def suffice(self, cell: Cell, policies: Sequence[int]) -> bool:
        """Whether all replays that labels in the cell rest on have been run, of those that will."""
        return all(self._awaited[p].isdisjoint(self._needed(cell, p)) for p in policies)

    def replays(self, cell: Cell, policies: Sequence[int]) -> list[dict[int, Replays]]:
        """What is known about each episode of a cell that was noted, policy by policy."""
        return [self._replays_of(cell, place) for place in policies]

    def _replays_of(self, cell: Cell, place: int) -> dict[int, Replays]:
        said: dict[str, Any] = {
            "home": self._said_at_home(cell, place),
            "second_horizon": self._recovered[place, _key(cell)],
            **self._undisturbed(cell, place),
        }
        whole: dict[str, Any] = {
            "home_success": self._home_success(place),
            "cell_status": self._statuses.get(cell.name),
        }
        return {
            self._first + k: Replays(**{n: _episode(x, k) for n, x in said.items()}, **whole)
            for k in range(len(self._known[place, _key(cell)]))
        }

    def _home_success(self, place: int) -> float | None:
        """Success in what the policy was trained on, by shares; None where that was not run."""
        home = self._homes[place]
        shares = {} if home is None or not self._whole else home.shares
        rates = {d: self._known.get((place, (d, None))) for d in shares}
        known = [
            shares[d] * self._rate(place, d, flags)
            for d, flags in rates.items()
            if flags is not None
        ]
        return sum(known) if known and len(known) == len(shares) else None

    def _rate(self, place: int, home: Discretization, flags: Flags) -> float:
        """Share of a policy's episodes at home that succeeded, earlier ones among them."""
        told = self._before[place] if self._before else {}
        succeeded, episodes = told.get(home.name, (0, 0))
        return (succeeded + int(flags.sum())) / (episodes + flags.size)

    def _needed(self, cell: Cell, place: int) -> set[Key]:
        return _rests_on(cell, self._homes[place])

    def _said_at_home(self, cell: Cell, place: int) -> Flags | HomeReplay:
        """Whether each episode succeeded in one of the training discretizations, all being run."""
        home = self._homes[place]
        if home is None:
            return None if place in self._homeless else "no home"
        if cell.discretization in home.shares:
            return "is home"
        runs = [self._known.get((place, (d, _disturbance(cell)))) for d in home.shares]
        known = [run for run in runs if run is not None]
        return np.any(known, axis=0) if len(known) == len(runs) else None

    def _undisturbed(self, cell: Cell, place: int) -> dict[str, Flags | None]:
        """The unperturbed cell answers for noise and delays that a perturbation alone brings in."""
        plain = self._known.get((place, (cell.discretization, None)))
        return {
            replay: plain if self._changes_only(cell, names) else None
            for replay, names in _DISTURBANCES.items()
        }

    def _changes_only(self, cell: Cell, names: set[str]) -> bool:
        """Whether the perturbation changes these arguments alone, from their undisturbed values."""
        if cell.perturbation is None or not set(cell.perturbation.environment) <= names:
            return False
        plain = replace(cell, perturbation=None).arguments(self._environment)
        return all(plain.get(n, getattr(Settings, n)) == getattr(Settings, n) for n in names)


def with_what_they_rest_on(
    missing: Sequence[Cell], cells: Sequence[Cell], home: Home | None
) -> tuple[Cell, ...]:
    """Cells that are to be evaluated, and those that labels in them rest on, in order.

    Args:
        missing: cells without records.
        cells: of the policy, those among them.
        home: what it was trained on.
    """
    keys = {key for cell in missing for key in (_key(cell), *_rests_on(cell, home))}
    return tuple(cell for cell in cells if _key(cell) in keys)


def _rests_on(cell: Cell, home: Home | None) -> set[Key]:
    shares = () if home is None else home.shares
    at_home = {(d, disturbance) for d in shares for disturbance in (_disturbance(cell), None)}
    return {*at_home, (cell.discretization, None)} - {_key(cell)}


def _key(cell: Cell) -> Key:
    return cell.discretization, _disturbance(cell)


def _disturbance(cell: Cell) -> str | None:
    return cell.perturbation.name if cell.perturbation else None


def _episode(said: Flags | HomeReplay, episode: int) -> Any:
    return bool(said[episode]) if isinstance(said, np.ndarray) else said
