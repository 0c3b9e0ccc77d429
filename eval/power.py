"""The family of declared tests, and how many seeds they take in simulated worlds."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import msgspec
import numpy as np

from . import verdict as rules
from .statistics import DRAWS, Estimate, Floats, Part, holm, mean_rate

VerdictCode: TypeAlias = Literal[
    "fails", "transfers", "inconclusive",
    "contract_error", "not_learned", "unachievable", "too_slow", "undecided",
]  # fmt: skip
"""The last five are marks of comparisons without a verdict: of both, of the row, or of the cell."""

WITHOUT_VERDICT = ("contract_error", "not_learned", "unachievable", "too_slow", "undecided")


@dataclass(frozen=True)
class Comparison:
    """One transfer to judge: policies trained in discretization i, evaluated in j.

    Attributes
    ----------
    row, cell
        Names of the policies' row and of j; together unique in their family.
    rates
        What the loss is made of.
    achieved
        Whether j can be solved at all, decided without these policies.
    contract_kept
        Whether j keeps the contract of i, compared before any integration; None: not compared.
    """

    row: str
    cell: str
    rates: rules.Rates
    achieved: rules.Achieved
    contract_kept: bool | None = None


class Verdict(Part, frozen=True, kw_only=True):
    """Verdict on one declared transfer; the p-values are null without one.

    Attributes:
        row: name of the row.
        cell: name of the cell that its policies were transferred to.
        verdict: `fails`, `transfers`, `inconclusive`; without a verdict `contract_error`,
            `not_learned`, or the cell's status.
        total: success at home minus success here; positive is worse. The next three add up to it.
        difficulty: what policies trained here and the hand-made controller do not reach either.
        deadline: what is won back within a second horizon.
        overfitting: the rest, which the verdict is about.
        seeds: how many training seeds it rests on.
        natives: how many training seeds the policies trained in the cell have; null without any.
        seeds_for_transfers: with how many training seeds at least `transfers` can be shown.
        p_exceeds: p-value for "overfitting > 0.2".
        p_equivalent: p-value for "overfitting within ±0.1".
        p_exceeds_adjusted: p-value for "overfitting > 0.2" after Holm's procedure over the family,
            divided by the share of the level that this look has; 1 where it has none.
        p_equivalent_adjusted: the same for "overfitting within ±0.1".
        seeds_wanted: with how many training seeds four in five such panels would decide an
            `inconclusive` one; null where eight times as many would not, or there is no need.
    """

    row: str
    cell: str
    verdict: VerdictCode
    total: Estimate
    difficulty: Estimate
    deadline: Estimate
    overfitting: Estimate
    seeds: int
    natives: int | None
    seeds_for_transfers: int
    p_exceeds: float | None = None
    p_equivalent: float | None = None
    p_exceeds_adjusted: float | None = None
    p_equivalent_adjusted: float | None = None
    seeds_wanted: int | None = None

    @property
    def few(self) -> bool:
        """Whether it, or the policies trained in the cell, have too few seeds for any test."""
        return (
            min(self.seeds, self.seeds if self.natives is None else self.natives) < rules.MIN_SEEDS
        )


def judge_family(
    comparisons: Sequence[Comparison], looks: rules.Looks = rules.FIRST_LOOK, *, draws: int = DRAWS
) -> tuple[Verdict, ...]:
    """Judge a declared family of transfers by overfitting; see `Loss`.

    - `contract_error`: observation, command, force or acceleration differ from home's at the same
      states; `not_learned`: mean home success below 0.5; `unachievable`, `too_slow`,
      `undecided`: the cell's status. No test is made, and the comparison does not count towards
      the family, but for `undecided`, which policies that are judged in the cell may have been
      able to change.
    - `inconclusive`: a group has fewer than 5 training seeds. It still counts towards the
      family, so that an unfinished panel is never judged more lightly than a finished one.
    - `fails`: "overfitting > 0.2" has an adjusted p-value below 0.05.
    - `transfers`: "overfitting within ±0.1" (two one-sided tests) has one below 0.05.
    - `inconclusive`: neither.

    Each of the two tests is corrected over the family by itself: wrong `fails` in the family
    have a chance of at most 0.05, and so have wrong `transfers`. They are two questions, of
    which a reader acts on one, and no comparison can be given both answers. The tests hold their
    level for seeds that are all or nothing as for those that are not; docs/explanation/verdicts.md
    has what was simulated.

    A run that grows until it says something is looked at more than once. Every look has a share
    of the level (`Looks`), by which its p-values are divided after Holm's procedure, so that these
    chances hold for all looks together.

    Equivalence is hard to show: seeds that all succeed leave room for a tenth that fail, and
    0.9**seeds is the chance to see none of these. With every rate at 1.0, a family of one needs
    33 seeds at the first look, one of four 46 and one of six 50; at the only planned look 30, 44
    and 47.

    Parameters
    ----------
    comparisons
        The family. The error rates hold where it was chosen without a look at the results.
    looks
        Earlier looks at its verdicts, and those that were planned.
    draws
        Draws of every test, and of intervals as far as these have as many.

    Returns
    -------
    One verdict for each comparison, in order.

    Raises
    ------
    ValueError
        If a name occurs twice, or as `Rates`.
    """
    rules.require_unique([f"{c.row} → {c.cell}" for c in comparisons], "comparison")
    marks = [_mark(comparison) for comparison in comparisons]
    tested = [c.rates for c, mark in zip(comparisons, marks, strict=True) if mark is None]
    exceeds = [
        rules.p_overfitting_exceeds(rates, rules.FAIL_MARGIN, draws=draws) for rates in tested
    ]
    equivalent = [
        rules.p_overfitting_within(rates, rules.EQUIVALENCE_MARGIN, draws=draws) for rates in tested
    ]
    open_tests = [1.0] * marks.count("undecided")
    shares = [looks.shares(len(rates.home)) for rates in tested]
    adjusted = [
        [
            rules.adjust_for_look(p, share)
            for p, share in zip(holm([*found, *open_tests]), own, strict=False)
        ]
        for found, own in (
            (exceeds, [one.exceeds for one in shares]),
            (equivalent, [one.equivalent for one in shares]),
        )
    ]
    p_values = zip(exceeds, equivalent, *adjusted, strict=True)
    return tuple(
        _verdict(c, mark, next(p_values) if mark is None else None, looks, draws)
        for c, mark in zip(comparisons, marks, strict=True)
    )


def postpone(verdict: Verdict) -> Verdict:
    """The same without its verdict, where not all seeds that were declared are there."""
    if verdict.verdict in WITHOUT_VERDICT:
        return verdict
    p_values = ("p_exceeds", "p_equivalent", "p_exceeds_adjusted", "p_equivalent_adjusted")
    nothing = dict.fromkeys((*p_values, "seeds_wanted"))
    return msgspec.structs.replace(verdict, verdict="inconclusive", **nothing)


def _mark(comparison: Comparison) -> VerdictCode | None:
    """Why there is no verdict; None where there is one."""
    if comparison.contract_kept is False:
        return "contract_error"
    if mean_rate(comparison.rates.home) < rules.LEARNED:
        return "not_learned"
    status = comparison.achieved.status
    return None if status == "achievable" else status


def _verdict(
    comparison: Comparison,
    mark: VerdictCode | None,
    p: tuple[float, float, float, float] | None,
    looks: rules.Looks,
    draws: int,
) -> Verdict:
    rates = comparison.rates
    verdict = Verdict(
        row=comparison.row,
        cell=comparison.cell,
        verdict=mark or "inconclusive",
        **vars(rules.split(rates, draws=min(draws, rules.INTERVAL_DRAWS))),
        seeds=len(rates.home),
        natives=None if rates.native is None else len(rates.native),
        seeds_for_transfers=looks.min_seeds_equivalence,
    )
    if p is None:
        return verdict
    code: VerdictCode = "inconclusive"
    if not verdict.few:
        code = "fails" if p[2] < rules.ALPHA else "transfers" if p[3] < rules.ALPHA else code
    return msgspec.structs.replace(
        verdict,
        verdict=code,
        p_exceeds=p[0],
        p_equivalent=p[1],
        p_exceeds_adjusted=p[2],
        p_equivalent_adjusted=p[3],
    )


Draw: TypeAlias = Callable[[np.random.Generator, float, int], Floats]

_CONCENTRATION: Final = 10.0


def all_or_nothing(rng: np.random.Generator, mean: float, seeds: int) -> Floats:
    """True rates of seeds that succeed from every start or from none."""
    return (rng.random(seeds) < mean).astype(np.float64)


def smooth(rng: np.random.Generator, mean: float, seeds: int) -> Floats:
    """True rates from a Beta law; its standard deviation at a mean of 0.9 is 0.09."""
    if mean in (0.0, 1.0):
        return np.full(seeds, mean)
    return rng.beta(_CONCENTRATION * mean, _CONCENTRATION * (1.0 - mean), seeds)


def draw_mixed_rates(rng: np.random.Generator, mean: float, seeds: int) -> Floats:
    """Half of what is missing to 1 is lost by seeds that fail altogether, half smoothly."""
    lost = 0.5 * (1.0 - mean)
    return np.where(rng.random(seeds) < lost, 0.0, smooth(rng, mean / (1.0 - lost), seeds))


WORLDS: Final[dict[str, Draw]] = {
    "all or nothing": all_or_nothing,
    "smooth": smooth,
    "mixed": draw_mixed_rates,
}


def draw_measured_rates(
    rng: np.random.Generator, draw: Draw, mean: float, seeds: int, starts: int
) -> Floats:
    """Success rates that seeds of one world show, each from starts of its own, shape (seeds,)."""
    return np.asarray(rng.binomial(starts, draw(rng, mean, seeds)) / starts)


OVERFITTING: Final = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)
"""True overfitting for which power is stated."""

HOME: Final = 0.99
"""True success at home, and of natives, for which it is."""

WANTED: Final = 0.8
"""Chance of a verdict from which on a number of seeds is said to decide."""

FARTHEST: Final = 8
"""How many times the seeds that there are may be said to be wanted."""

_GROWTH: Final = 1.15
_DRAWS: Final = 4000
_FINE: Final = 50_000
_MOST: Final = 400


@dataclass(frozen=True)
class Power:
    """Chances of both verdicts on one transfer, each the lowest and highest of three worlds.

    Attributes
    ----------
    overfitting
        The true one.
    transfers, fails
        Chance of the verdict, (lowest, highest), in [0, 1].
    """

    overfitting: float
    transfers: tuple[float, float]
    fails: tuple[float, float]


def verdict_chances(
    seeds: int,
    natives: int,
    starts: int,
    family: int,
    looks: rules.Looks = rules.FIRST_LOOK,
    *,
    repeats: int = 100,
) -> tuple[Power, ...]:
    """Chances of a verdict, simulated in the three worlds of `WORLDS`.

    Policies and natives succeed at home with 0.99, a hand-made controller always. Every verdict
    is taken at the level of its look, divided by the size of the family: Holm's procedure is never
    harder.

    Parameters
    ----------
    seeds, natives
        Training seeds of the policies that are judged and of those trained in the cell.
    starts
        Of every seed.
    family
        How many transfers are declared.
    looks
        Earlier looks, and those that were planned.
    repeats
        Simulated transfers for each chance.
    """
    rng, shares = np.random.default_rng(0), looks.shares(seeds)

    def chances(draw: Draw, lost: float) -> tuple[float, float]:
        outcomes = [
            _verdicts(_simulate_rates(rng, draw, lost, seeds, natives, starts), shares, family)
            for _ in range(repeats)
        ]
        first, second = np.mean(outcomes, axis=0)
        return float(first), float(second)

    found = []
    for lost in OVERFITTING:
        transfers, fails = zip(*(chances(draw, lost) for draw in WORLDS.values()), strict=True)
        found.append(Power(lost, (min(transfers), max(transfers)), (min(fails), max(fails))))
    return tuple(found)


def fewest_seeds(family: int, looks: rules.Looks = rules.FIRST_LOOK) -> int:
    """With how many seeds, all of which always succeed, every member of a family `transfers`.

    At the look that comes next, or at any planned one.
    """

    def shown(seeds: int) -> bool:
        rates = rules.Rates(*(np.ones(seeds),) * 3)
        own = rules.Looks((), (seeds,) * len(looks.planned)) if looks.planned else looks
        _, level = own.shares(seeds).levels
        return (
            rules.p_overfitting_within(rates, rules.EQUIVALENCE_MARGIN, draws=_FINE)
            < level / family
        )

    tried = range(rules.MIN_SEEDS, _MOST)
    return rules.MIN_SEEDS + bisect_left(tried, True, key=shown)


def seeds_wanted(
    rates: rules.Rates, family: int, looks: rules.Looks = rules.FIRST_LOOK, *, repeats: int = 60
) -> int | None:
    """How many seeds would decide a transfer, if more were as those that there are.

    Parameters
    ----------
    rates
        What was measured.
    family
        How many transfers are tested.
    looks
        Earlier looks, this one included, and those that were planned: of these, one must come.
    repeats
        Resamples of the seeds for each number tried.

    Returns
    -------
    The smallest number tried with which four in five resamples get a verdict; None if eight times
    as many seeds do not suffice: overfitting then lies between the margins, or near one; or if no
    planned look does.
    """
    rng = np.random.default_rng(0)
    for seeds in _more_seeds(len(rates.home), looks.planned):
        shares = looks.shares(seeds)
        outcomes = [_verdicts(_resample(rng, rates, seeds), shares, family) for _ in range(repeats)]
        if np.mean([any(one) for one in outcomes]) >= WANTED:
            return seeds
    return None


def _more_seeds(now: int, planned: Sequence[int]) -> Iterator[int]:
    """Numbers of seeds to try: those of planned looks, or ever more."""
    if planned:
        yield from (seeds for seeds in planned if seeds > now)
        return
    seeds = now
    while seeds < FARTHEST * now:
        seeds = math.ceil(seeds * _GROWTH)
        yield seeds


def _verdicts(rates: rules.Rates, shares: rules.Shares, family: int) -> tuple[bool, bool]:
    """Whether a transfer is said to hold, and whether to fail."""
    above, within = (level / family for level in shares.levels)
    if above > 0.0 and rules.p_overfitting_exceeds(rates, rules.FAIL_MARGIN, draws=_DRAWS) < above:
        return False, True
    if within == 0.0:
        return False, False
    return rules.p_overfitting_within(rates, rules.EQUIVALENCE_MARGIN, draws=_DRAWS) < within, False


def _simulate_rates(
    rng: np.random.Generator, draw: Draw, lost: float, seeds: int, natives: int, starts: int
) -> rules.Rates:
    home = draw_measured_rates(rng, draw, HOME, seeds, starts)
    there = draw_measured_rates(rng, draw, HOME - lost, seeds, starts)
    native = draw_measured_rates(rng, draw, HOME, natives, starts) if natives else None
    return rules.Rates(home, there, there, native, np.ones(100))


def _resample(rng: np.random.Generator, rates: rules.Rates, seeds: int) -> rules.Rates:
    """So many seeds drawn from those that there are, natives likewise."""
    row = rates.row[:, rng.integers(rates.row.shape[1], size=seeds)]
    native = None if rates.native is None else np.asarray(rates.native)
    if native is not None:
        native = native[rng.integers(native.size, size=native.size)]
    return rules.Rates(row[0], row[1], row[2], native, rates.handmade)
