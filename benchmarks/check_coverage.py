"""How often does the interval of `integ-gym check` hold the loss, though its width ends the check?

    python benchmarks/check_coverage.py [--repeats 1000]

Losses of single seeds are drawn from laws whose mean is known, and seeds are added by the rule of
the command. Printed are, for every law, the share of checks whose interval holds the mean, the mean
number of seeds, and the share of checks that end with a half-width above 0.2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt
from measuring import results

from integ_gym.eval.loss_check import (
    FIRST_SEEDS,
    MOST_SEEDS,
    NARROW,
    next_seed_count,
)
from integ_gym.eval.verdict import checked_loss

Floats = npt.NDArray[np.float64]
Draw = Callable[[np.random.Generator], Floats]
DRAWS = 4000
STARTS = 20


def laws() -> Iterator[tuple[str, float, Draw]]:
    """Name, mean loss, and what draws the losses of seeds."""
    for p in (0.01, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 0.95, 0.99):
        yield f"all or nothing, {p:g}", p, lambda r, p=p: (r.random(MOST_SEEDS) < p).astype(float)
    for mean, sd in (
        *((0.05, 0.1), (0.1, 0.15), (0.2, 0.2), (0.3, 0.25)),
        *((0.5, 0.25), (0.5, 0.35), (0.7, 0.3), (0.9, 0.1)),
    ):
        size = mean * (1.0 - mean) / sd**2 - 1.0
        a, b = mean * size, (1.0 - mean) * size
        yield (
            f"beta, {mean:g}, sd {sd:g}",
            mean,
            lambda r, a=a, b=b: r.binomial(STARTS, r.beta(a, b, MOST_SEEDS)) / STARTS,
        )
    few = [-0.5, 0.0, 0.5, 1.0]
    yield "gains and losses", 0.1, lambda r: r.choice(few, MOST_SEEDS, p=[0.2, 0.5, 0.2, 0.1])
    all_ = [-1.0, 0.0, 1.0]
    yield "total gains and losses", 0.0, lambda r: r.choice(all_, MOST_SEEDS, p=[0.15, 0.7, 0.15])


def checked(losses: Floats, draws: int = DRAWS) -> tuple[int, float, float]:
    """Seeds that a check ends with, and the ends of its interval."""
    seeds = FIRST_SEEDS
    while True:
        part = losses[:seeds]
        lost = checked_loss(np.maximum(part, 0.0), np.maximum(-part, 0.0), draws=draws)
        wanted = next_seed_count(seeds, 0.5 * (lost.high - lost.low))
        if wanted == seeds:
            return seeds, lost.low, lost.high
        seeds = wanted


def main() -> None:
    """Print the table."""
    parser = results.parser(__doc__)
    parser.add_argument("--repeats", type=int, default=1000)
    repeats = parser.parse_args().repeats
    print(f"{'losses of seeds':28} {'holds':>6} {'seeds':>6} {'too wide':>9}")
    shares = []
    for name, mean, draw in laws():
        generator = np.random.default_rng(12)
        found = [checked(draw(generator)) for _ in range(repeats)]
        held = np.mean([low - 1e-9 <= mean <= high + 1e-9 for _, low, high in found])
        wide = np.mean([high - low > 2.0 * NARROW for _, low, high in found])
        shares.append(held)
        print(f"{name:28} {held:6.3f} {np.mean([n for n, *_ in found]):6.1f} {wide:9.2f}")
    print(f"{'mean, least':28} {np.mean(shares):6.3f} {min(shares):6.3f}")


if __name__ == "__main__":
    main()
