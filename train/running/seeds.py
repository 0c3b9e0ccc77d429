"""Seeds of a training run that follow from its one seed."""

from __future__ import annotations

import numpy as np


def first_lane_seed(seed: int) -> int:
    """Seed of the first training environment; the others count up from it.

    Spread out, so that runs with neighbouring seeds do not share start states.
    """
    return int(np.random.SeedSequence(seed).generate_state(1)[0])
