"""The bar of `evidence verify`, over all that takes long."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from integ_gym.support.packages.extras import absent
from integ_gym.support.processes.workers import ESTIMATE_LOOK, work_bar

HASH_SECONDS, TRACE_SECONDS, REPLAY_SECONDS = 1e-4, 2e-4, 1e-2
"""Time of one record, s: of its hash, of its outcome from its trace, of playing it again."""


class Checking:
    """What is being checked, and how much of it is done, in a bar on standard error.

    Args:
        seconds: that it takes, about.
        shown: whether the bar is; never without the package that draws it, which no check needs.
    """

    def __init__(self, seconds: float, shown: bool) -> None:
        self._bar: Any = None
        if shown and not absent(["tqdm"]):
            self._bar = work_bar("verify", seconds, True, bar_format=ESTIMATE_LOOK)

    def begin(self, phase: str, each: float = 0.0) -> Callable[[int], None]:
        """Say what is checked now; what counts the records of it.

        Args:
            phase: in words.
            each: time that one takes, s.
        """
        if self._bar is not None:
            self._bar.set_postfix_str(phase)
        return partial(self._add, each)

    def close(self) -> None:
        """Leave the bar as a full one: what was expected of it is a guess."""
        if self._bar is not None:
            self._bar.set_postfix_str("", refresh=False)
            self._bar.fill()
            self._bar.close()

    def _add(self, each: float, count: int) -> None:
        if self._bar is not None:
            self._bar.update(count * each)
