"""Do a panel's verdicts and intervals keep their promises?

    python benchmarks/error_rates.py [--seeds 10 20 48 64] [--family 4] [--starts 20]
                                     [--repeats 400] [--looks 32 40] [--wrong] [--json FILE]

Simulates families of declared transfers in three worlds: seeds that succeed from every start or
from none, seeds whose rates vary smoothly (Beta laws), and a mixture (half of what is missing to 1
is lost by seeds that fail altogether, half smoothly). Every seed has starts of its own, and a
hand-made controller has 100. It prints how often a family is given any wrong `fails` or
`transfers` where overfitting is exactly at a margin (at most 0.05 is promised), how often a
comparison is given its right verdict where overfitting is far from the margins, and how often the
95 % intervals of overfitting and of a plain success rate hold the truth. With `--looks`, verdicts
are also seen at these numbers of seeds, and one counts that is given at any look. `--wrong` leaves
out the comparisons whose verdict would be right.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from measuring import results
from tqdm import tqdm

from integ_gym.eval.power import WORLDS, Comparison, Draw, draw_measured_rates, judge_family
from integ_gym.eval.statistics import rate_interval
from integ_gym.eval.verdict import Achieved, Looks, Rates, split

DRAWS = 4000
HANDMADE_STARTS = 100
SOLVED = Achieved("achievable")


class Case(NamedTuple):
    """True means of one comparison; without a hand-made controller None.

    ``asked`` is what is counted: a wrong verdict at a margin, or the right one.
    """

    name: str
    home: float
    native: float
    handmade: float | None
    recovered: float
    asked: str
    wrong: bool = True

    @property
    def overfitting(self) -> float:
        """The true one."""
        possible = max(self.native, -1.0 if self.handmade is None else self.handmade)
        return min(self.home, possible) - self.recovered


CASES = (
    Case("0.1, yardsticks perfect", 1.0, 1.0, 1.0, 0.9, "transfers"),
    Case("0.1, all vary", 0.95, 0.95, None, 0.85, "transfers"),
    Case("0.1, two yardsticks", 0.9, 0.9, 0.9, 0.8, "transfers"),
    Case("−0.1, all vary", 0.9, 0.9, None, 1.0, "transfers"),
    Case("−0.1, two yardsticks", 0.95, 0.8, 0.8, 0.9, "transfers"),
    Case("0.2, yardsticks perfect", 1.0, 1.0, 1.0, 0.8, "fails"),
    Case("0.2, all vary", 0.9, 0.9, None, 0.7, "fails"),
    Case("0.2, two yardsticks", 1.0, 0.8, 0.8, 0.6, "fails"),
    Case("0, all perfect", 1.0, 1.0, 1.0, 1.0, "transfers", wrong=False),
    Case("0, one percent lost", 0.99, 0.99, 1.0, 0.99, "transfers", wrong=False),
    Case("0, three percent lost", 0.97, 0.97, 1.0, 0.97, "transfers", wrong=False),
    Case("0.35", 0.97, 0.97, 1.0, 0.62, "fails", wrong=False),
    Case("0.5", 0.97, 0.97, 1.0, 0.47, "fails", wrong=False),
)


def rates_of(case: Case, draw: Draw, seeds: int, starts: int, rng: np.random.Generator) -> Rates:
    """One comparison's measured rates."""
    handmade = None
    if case.handmade is not None:
        handmade = (rng.random(HANDMADE_STARTS) < case.handmade).astype(np.float64)
    recovered, home, native = (
        draw_measured_rates(rng, draw, mean, seeds, starts)
        for mean in (case.recovered, case.home, case.native)
    )
    return Rates(home, recovered, recovered, native, handmade)


def _first(comparison: Comparison, count: int) -> Comparison:
    """The same with the first seeds alone."""
    rates = comparison.rates
    native = None if rates.native is None else rates.native[:count]
    return Comparison(
        comparison.row,
        comparison.cell,
        Rates(*rates.row[:, :count], native, rates.handmade),
        SOLVED,
    )


def measure(
    case: Case, world: str, seeds: int, given: argparse.Namespace, rng: np.random.Generator
) -> dict[str, object]:
    """Verdicts and coverage of one case in one world."""
    verdicts, held, rate_held = [], [], []
    for _ in range(given.repeats):
        family = [
            Comparison(str(k), "j", rates_of(case, WORLDS[world], seeds, given.starts, rng), SOLVED)
            for k in range(given.family)
        ]
        looks = [count for count in given.looks if count < seeds]
        seen = [[_first(one, count) for one in family] for count in looks]
        wrong_or_right = [
            [j.verdict == case.asked for j in judge_family(f, Looks(tuple(looks[:k])), draws=DRAWS)]
            for k, f in enumerate((*seen, family))
        ]
        verdicts.append(np.any(wrong_or_right, axis=0))
        found = split(family[0].rates, draws=DRAWS).overfitting
        held.append(found.low <= case.overfitting <= found.high)
        rate = rate_interval(family[0].rates.recovered, draws=DRAWS)
        rate_held.append(rate.low <= case.recovered <= rate.high)
    given_verdicts = np.array(verdicts)
    return {
        "overfitting": case.name,
        "world": world,
        "seeds": seeds,
        "verdict": case.asked,
        "wrong": case.wrong,
        "any of the family": float(given_verdicts.any(axis=1).mean()),
        "each": float(given_verdicts.mean()),
        "coverage": float(np.mean(held)),
        "coverage of a rate": float(np.mean(rate_held)),
    }


def simulate(given: argparse.Namespace) -> Iterator[dict[str, object]]:
    """All cases in all worlds."""
    rng = np.random.default_rng(given.seed)
    cases = [case for case in CASES if case.wrong or not given.wrong]
    plan = [(case, world, seeds) for seeds in given.seeds for case in cases for world in WORLDS]
    for case, world, seeds in tqdm(plan, unit=" cases"):
        yield measure(case, world, seeds, given, rng)


def main() -> None:
    """Simulate and print."""
    parser = results.parser(__doc__, file=True)
    parser.add_argument("--seeds", type=int, nargs="+", default=[10, 20, 48, 64])
    parser.add_argument("--family", type=int, default=4, help="declared transfers")
    parser.add_argument("--starts", type=int, default=20, help="of every seed")
    parser.add_argument("--repeats", type=int, default=400, help="simulated families per case")
    parser.add_argument(
        "--looks", type=int, nargs="*", default=[], help="seeds at which verdicts are seen before"
    )
    parser.add_argument("--wrong", action="store_true", help="only wrong verdicts")
    parser.add_argument("--seed", type=int, default=0, help="of the simulation")
    given = parser.parse_args()
    found = list(simulate(given))
    titles = {True: "wrong verdicts at the margins", False: "right verdicts"}
    for wrong in sorted({bool(one["wrong"]) for one in found}, reverse=True):
        print(f"\n{titles[wrong]}, families of {given.family}, {given.starts} starts per seed")
        chosen = [one for one in found if one["wrong"] is wrong]
        names = [name for name in chosen[0] if name != "wrong"]
        results.print_table(names, [[_cell(one[name]) for name in names] for one in chosen])
    results.write(given.json, {"cases": found}, ["numpy", "integ-gym"])


def _cell(value: object) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
