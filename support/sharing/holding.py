"""A claim kept alive while its work is under way, and pauses of those that find nothing to do."""

from __future__ import annotations

import random
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from .claims import Claim
from .folder_files import Gone

BEATS = 4
"""Signs of life in a lease."""

FIRST_PAUSE, LONGEST_PAUSE = 1.0, 30.0
"""Between two looks of a worker that finds nothing to do, s."""


@contextmanager
def held(claim: Claim, lease: float) -> Iterator[None]:
    """Renew a claim from a thread of its own until the block is left."""
    over = threading.Event()
    thread = threading.Thread(target=_renew, args=(claim, lease / BEATS, over), daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _renew(claim: Claim, interval: float, over: threading.Event) -> None:
    while not over.wait(interval):
        try:
            if not claim.renew():
                return
        except Gone:
            return
        except OSError:  # a file server that does not answer for a while
            continue


def pauses(lease: float, rng: random.Random) -> Iterator[float]:
    """How long to wait before each further look, s: longer and longer, no two workers alike."""
    pause = FIRST_PAUSE
    while True:
        yield min(pause, LONGEST_PAUSE, lease / BEATS) * rng.uniform(0.75, 1.25)
        pause = min(2.0 * pause, LONGEST_PAUSE)
