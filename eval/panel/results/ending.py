"""What is done at the end of a run, in a bar."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import accumulate
from typing import Final, Literal

from ..running.work import panel_bar

Phase = Literal["checking records", "judging", "drawing figures", "writing the page"]

CHECKING: Final = "checking records"
JUDGING: Final = "judging"
DRAWING: Final = "drawing figures"
WRITING: Final = "writing the page"

_SECONDS: dict[Phase, float] = {CHECKING: 3.0, JUDGING: 9.0, DRAWING: 5.0, WRITING: 3.0}
"""What is done, in words and in order, and time that it takes of the quick panel, s."""

_BEFORE = dict(zip(_SECONDS, accumulate(_SECONDS.values(), initial=0.0), strict=False))

Begin = Callable[[Phase], None]
"""Told what is done now."""


def untold(phase: Phase) -> None:
    """Nobody is told."""


@contextmanager
def phases(label: str, shown: bool) -> Iterator[Begin]:
    """What is to be told what is done now, for a bar over all of it.

    Args:
        label: of the run.
        shown: whether the bar is.
    """
    with panel_bar(f"{label}, page", sum(_SECONDS.values()), shown) as bar:

        def begin(phase: Phase) -> None:
            bar.update(_BEFORE[phase] - bar.n)
            bar.describe(phase)

        yield begin
        bar.describe("")
