"""How fast a cart leaves the stop that it runs into, in engines as their users get them.

    python benchmarks/cart_stops.py

The cart-pole of the short track in "Does a policy learn the engine?", with the pole at rest
downwards, runs into a stop at several speeds, each from three places before it. What counts is its
speed at the first decision after it has turned round, as a share of that before: least and greatest
over the places. Where the cart has not turned round after half a second it has 0. `exact`: without
an error of the step. `damped`: exact, with a damping of 10 s/m.
"""

from __future__ import annotations

import sys
from contextlib import closing
from math import pi
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

sys.path.insert(0, str(Path(__file__).parent / "tables"))

from learned_engines import ENGINES, ENV_ID, PERIOD, TASKS, arguments
from measuring.results import markdown, parser
from stop_damping import DAMPINGS

SHORT = "short track"
SPEEDS = (0.5, 1.0, 2.0, 3.0)
"""Of the cart before the stop, m/s."""
DISTANCES = (0.06, 0.08, 0.1)
"""From the start to the stop, m."""
WATCHED = 0.5
"""s."""


def list_settings() -> dict[str, dict[str, Any]]:
    """Arguments of the environment, by what the table calls them."""
    as_got = {engine.name: arguments(SHORT, "as got", engine.name) for engine in ENGINES}
    exact = {**as_got["native"], "integrator": "reference"}
    damped = {**exact, "stop_damping": max(DAMPINGS)}
    return {**as_got, "native, exact": exact, "native, exact, damped": damped}


def measure_rebound(given: dict[str, Any], speed: float) -> list[float]:
    """Speed after the stop over that before, from each place."""
    found = []
    limit = TASKS[SHORT].track_limit
    with closing(gym.make(ENV_ID, **given)) as env:
        for distance in DISTANCES:
            env.reset(options={"state": (limit - distance, speed, pi, 0.0)})
            rebound = 0.0
            for _ in range(round(WATCHED / PERIOD)):
                env.step(np.zeros(1, dtype=np.float32))
                x, x_dot, *_ = env.unwrapped.state  # type: ignore[attr-defined]
                if x < limit and x_dot < 0.0:
                    rebound = -x_dot / speed
                    break
            found.append(rebound)
    return found


def measure_rebounds() -> dict[str, dict[float, list[float]]]:
    """Of all settings, at each speed."""
    return {
        name: {speed: measure_rebound(given, speed) for speed in SPEEDS}
        for name, given in list_settings().items()
    }


def format_table() -> list[str]:
    """Of the page, as Markdown."""
    rows = [
        [name, *[f"{min(found):.2f}–{max(found):.2f}" for found in by_speed.values()]]
        for name, by_speed in measure_rebounds().items()
    ]
    return markdown(["stops of", *[f"{speed:g} m/s" for speed in SPEEDS]], rows)


if __name__ == "__main__":
    parser(__doc__).parse_args()
    print("\n".join(format_table()))
