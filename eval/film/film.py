"""A film: episodes of one policy side by side, frame by frame."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import overload

import numpy as np
import numpy.typing as npt

from integ_gym.envs.registries import TRUTH
from integ_gym.envs.rendering.cockpit import Pane, Panes
from integ_gym.envs.settings import NATIVE, Discretization

from .episode import Episode
from .writing import write_film

Frame = npt.NDArray[np.uint8]

FPS = 20
"""Frames per second: the times between them are whole hundredths, which a GIF keeps."""


LEAST_START = 0.05
"""Energy at the start below which it is not told, J."""


class Film(Sequence[Frame]):
    """Frames of one policy's episodes side by side, in real time; each is drawn when asked for.

    Attributes:
        episodes: from left to right.
        fps: frames per second.

    Args:
        episodes: of one plant.
        trained_on: what the policy was trained on; empty where that is not known.
        note: what all of them have in common, in words.
    """

    fps = FPS

    def __init__(
        self, episodes: Sequence[Episode], trained_on: Sequence[Discretization] = (), note: str = ""
    ) -> None:
        self.episodes = tuple(episodes)
        self._trained_on = tuple(trained_on)
        self._note = note

    @property
    def success(self) -> dict[str, bool]:
        """Whether the policy succeeds, by the name of the discretization."""
        return {episode.discretization.name: episode.success for episode in self.episodes}

    @property
    def seconds(self) -> float:
        """How long the longest episode lasts, s."""
        return max(float(episode.times[-1]) for episode in self.episodes)

    def __len__(self) -> int:
        return math.floor(self.seconds * self.fps + 1e-6) + 1

    @overload
    def __getitem__(self, place: int) -> Frame: ...

    @overload
    def __getitem__(self, place: slice) -> list[Frame]: ...

    def __getitem__(self, place: int | slice) -> Frame | list[Frame]:
        """One frame, shape (height, width, 3); or a list of them for a slice."""
        if isinstance(place, slice):
            return [self[k] for k in range(*place.indices(len(self)))]
        if not -len(self) <= place < len(self):
            raise IndexError(f"the film has {len(self)} frames; there is no frame {place}")
        time = place % len(self) / self.fps
        moments = [episode.moment(time, self._shown) for episode in self.episodes]
        return self._panes.draw(moments, time)

    def __iter__(self) -> Iterator[Frame]:
        return (self[k] for k in range(len(self)))

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write it as ``.gif`` or ``.mp4``, by the path's ending.

        Raises:
            ValueError: for another ending.
            OSError: if the file cannot be written.
            ModuleNotFoundError: if an extra is missing, with the command that installs it.
        """
        return write_film(self, self.fps, Path(path))

    @cached_property
    def _shown(self) -> tuple[str, ...]:
        """Names of the amounts of energy that are shown: a start at rest and no losses are not."""
        ledgers = [episode.ledger() for episode in self.episodes]
        least = {"start": LEAST_START, "losses": 0.0}
        return tuple(
            name
            for name in ledgers[0]
            if name not in least or any(np.abs(own[name]).max() > least[name] for own in ledgers)
        )

    @cached_property
    def _panes(self) -> Panes:
        panes = [
            Pane(episode.setup, *self._titles(episode.discretization), episode.success)
            for episode in self.episodes
        ]
        ledgers = [episode.ledger() for episode in self.episodes]
        amounts = np.concatenate([own[name] for own in ledgers for name in self._shown])
        reach = float(np.nanmin(amounts)), float(np.nanmax(amounts))
        return Panes(panes, self._heading(), self._note, len(self._shown), reach)

    def _heading(self) -> str:
        cells = [episode.discretization for episode in self.episodes]
        if len(set(cells)) == 1:
            return "One policy, one start"
        same_engine = len({cell.engine for cell in cells}) == 1
        same_step = len({cell.dt for cell in cells if cell.integrator != TRUTH}) == 1
        what = "integrator" if same_engine and same_step else "discretization"
        return f"Same policy, same start. Only the {what} differs."

    def _titles(self, cell: Discretization) -> tuple[str, str]:
        """Name of a discretization, and what there is to know of it."""
        periods = {episode.discretization.control_period for episode in self.episodes}
        own = f"a decision every {cell.control_period:g} s" if len(periods) > 1 else ""
        trained = "trained here" if cell in self._trained_on else ""
        if cell.integrator == TRUTH:
            return "truth", ", ".join(filter(None, ("solved to rounding", own, trained)))
        name = cell.integrator.rpartition(":")[2].replace("_", " ")
        engine = "" if cell.engine == NATIVE else f"{cell.engine.rpartition(':')[2]} "
        return engine + name, ", ".join(filter(None, (f"dt {cell.dt:g} s", own, trained)))
