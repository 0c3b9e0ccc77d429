"""Streams of random numbers, the same in every run."""

from __future__ import annotations

from enum import IntEnum
from typing import Final

import numpy as np

_ENTROPY: Final = 1973


class Stream(IntEnum):
    """What a stream is for; streams are independent."""

    FIRST = 0
    SECOND = 1
    PAIRED = 2
    BOOTSTRAP = 3
    THIRD = 4


def generator(stream: Stream, prior: bool = False) -> np.random.Generator:
    """A new generator at the beginning of a stream, or of its own for what a prior adds."""
    return np.random.Generator(np.random.PCG64([_ENTROPY, stream, int(prior)]))
