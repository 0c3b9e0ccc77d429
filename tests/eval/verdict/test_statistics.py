"""Intervals and tests over training seeds, of returns, paired episodes and rankings: exact laws."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rate_laws import Array, lattice
from scipy import integrate, stats

from integ_gym.eval.statistics import (
    DRAWS,
    PROVEN,
    SHOWN,
    Difference,
    Estimate,
    draws_for,
    holm,
    iqm,
    iqm_interval,
    mean_interval,
    p_equivalent,
    paired_difference,
    paired_posterior,
    paired_return,
    paired_success,
    pearson,
    rank_violation,
    ranking_intervals,
    rate_interval,
    rate_posterior,
    unpaired_difference,
    unpaired_posterior,
)

several_rates = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12)
HOME, AWAY = [1.0, 0.9, 1.0, 0.8, 0.7, 0.95], [0.5, 0.8, 0.9, 0.9, 0.1, 0.6]
fast = settings(max_examples=8, deadline=None, derandomize=True)


def imhof(atoms: Array, weights: Array, at: float) -> float:
    """P(Dirichlet mean of the atoms <= at), exact: the inversion formula of Imhof (1961).

    The mean is at most c just when the sum of gamma variables times (atom − c) is at most 0.
    """
    scale = atoms - at

    def integrand(u: float) -> float:
        phase = float(np.sum(weights * np.arctan(scale * u)))
        return float(np.sin(phase) / (u * np.prod((1.0 + (scale * u) ** 2) ** (weights / 2.0))))

    value, _ = integrate.quad(integrand, 0.0, np.inf, limit=500)
    return 0.5 - float(value) / np.pi


@pytest.mark.parametrize(("seeds", "level"), [(3, 0.95), (10, 0.8)])
def test_all_or_nothing_seeds_give_the_jeffreys_interval(seeds: int, level: float) -> None:
    for k, rates in enumerate(lattice(seeds)):
        law = stats.beta(k + 0.5, seeds - k + 0.5)
        found = rate_interval(rates, level)
        assert found.estimate == pytest.approx(k / seeds, abs=1e-15)
        assert found.low == pytest.approx(0.0 if k == 0 else law.ppf((1 - level) / 2), abs=3e-3)
        assert found.high == pytest.approx(
            1.0 if k == seeds else law.ppf((1 + level) / 2), abs=3e-3
        )


@pytest.mark.parametrize("at", [0.7, 0.8])
def test_rate_posterior_agrees_with_exact_inversion(at: float) -> None:
    rates = np.array([0.55, 0.6, 0.8, 0.95, 1.0])
    exact = imhof(np.append(rates, [0.0, 1.0]), np.array([1, 1, 1, 1, 1, 0.5, 0.5]), at)
    assert 0.02 < exact < 0.98
    assert (rate_posterior(rates) <= at).mean() == pytest.approx(exact, abs=4e-3)


@pytest.mark.parametrize("at", [0.0, 0.35])
def test_paired_posterior_has_a_quarter_at_each_corner(at: float) -> None:
    home, away = np.array(HOME), np.array(AWAY)
    corners = np.array([0.0 - 0.0, 0.0 - 1.0, 1.0 - 0.0, 1.0 - 1.0])
    weights = np.array([1.0] * 6 + [0.25] * 4)
    exact = imhof(np.append(home - away, corners), weights, at)
    assert 0.01 < exact < 0.99
    assert (paired_posterior(home, away) <= at).mean() == pytest.approx(exact, abs=4e-3)
    difference = paired_difference(home, away)
    assert difference.interval.estimate == pytest.approx(np.mean(home - away), abs=1e-15)


@pytest.mark.parametrize("at", [0.0, 0.35])
def test_paired_tests_have_one_pair_that_speaks_against_the_claim(at: float) -> None:
    drop, weights = np.array(HOME) - np.array(AWAY), np.array([1.0] * 6 + [SHOWN])
    difference = paired_difference(HOME, AWAY)
    exceeds = imhof(np.append(drop, -1.0), weights, at)
    assert difference.p_greater(at) == pytest.approx(exceeds, abs=4e-3)
    less = 1.0 - imhof(np.append(drop, 1.0), weights, at)
    assert difference.p_less(at) == pytest.approx(less, abs=4e-3)
    assert exceeds + less > 1.0


@pytest.mark.parametrize(("k", "other", "size"), [(10, 5, 8), (7, 4, 10)])
def test_unpaired_groups_are_independent(k: int, other: int, size: int) -> None:
    many, few = lattice(10)[k], lattice(size)[other]
    middle = (np.arange(4000) + 0.5) / 4000

    def at_most(first: tuple[float, float], second: tuple[float, float]) -> float:
        """P(first − second <= 0.2) of two Beta laws."""
        return float(stats.beta(*second).sf(stats.beta(*first).ppf(middle) - 0.2).mean())

    posterior = at_most((k + 0.5, 10.5 - k), (other + 0.5, size - other + 0.5))
    assert (unpaired_posterior(many, few) <= 0.2).mean() == pytest.approx(posterior, abs=4e-3)
    difference = unpaired_difference(many, few)
    lowered = at_most((k, 10.0 + SHOWN - k), (other + SHOWN, float(size - other)))
    assert difference.p_greater(0.2) == pytest.approx(lowered, abs=4e-3)
    assert difference.interval.estimate == pytest.approx(k / 10 - other / size)


@pytest.mark.parametrize("seeds", [5, 40])
def test_equivalence_of_all_or_nothing_seeds_is_tested_exactly(seeds: int) -> None:
    """Against a perfect side, the p-value is the binomial tail of Clopper and Pearson."""
    for k, away in enumerate(lattice(seeds)):
        exact = stats.binom.cdf(seeds - k, seeds, 0.1)  # as few failures or fewer at a loss of 0.1
        found = p_equivalent([1.0] * seeds, away, 0.1)
        assert found == pytest.approx(max(exact, 0.9**seeds), abs=4e-3)


@given(rate=st.floats(0.0, 1.0), seeds=st.integers(1, 20))
@fast
def test_seeds_that_agree_do_not_give_certainty(rate: float, seeds: int) -> None:
    found = rate_interval([rate] * seeds)
    assert found.high - found.low > 0.5 / (seeds + 1)
    drop = paired_difference([rate] * seeds, [rate] * seeds).interval
    assert drop.high - drop.low > 0.1 / (seeds + 1)


@given(rates=several_rates, level=st.floats(0.01, 0.99))
@fast
def test_interval_holds_the_estimate_and_stays_in_range(rates: list[float], level: float) -> None:
    found = rate_interval(rates, level)
    assert 0.0 <= found.low <= found.estimate <= found.high <= 1.0
    assert found.estimate == pytest.approx(np.mean(rates), abs=1e-12)
    assert found.level == level


@given(data=st.data(), rates=several_rates)
@settings(fast, max_examples=4)
def test_order_of_seeds_does_not_matter(data: st.DataObject, rates: list[float]) -> None:
    order = data.draw(st.permutations(range(len(rates))))
    shuffled = [rates[i] for i in order]
    assert rate_interval(shuffled) == rate_interval(rates)
    away = [r * r for r in rates]
    shuffled_away = [away[i] for i in order]
    assert paired_difference(shuffled, shuffled_away) == paired_difference(rates, away)
    moved, still = unpaired_difference(shuffled, away), unpaired_difference(rates, away)
    assert np.array_equal(moved.lowered, still.lowered)
    assert np.array_equal(moved.raised, still.raised)


def test_pairing_matters() -> None:
    home, away = [1.0, 0.6, 1.0, 0.6], [0.9, 0.5, 0.9, 0.5]
    matched = paired_difference(home, away)
    crossed = paired_difference(home, away[1:] + away[:1])
    assert matched.interval.estimate == pytest.approx(crossed.interval.estimate)
    assert matched.p_greater() < crossed.p_greater()


@given(rates=several_rates)
@fast
def test_failure_rates_mirror_success_rates(rates: list[float]) -> None:
    there, back = rate_interval(rates), rate_interval([1.0 - r for r in rates])
    assert back.low == pytest.approx(1.0 - there.high, abs=0.01)
    assert back.high == pytest.approx(1.0 - there.low, abs=0.01)


def test_same_input_gives_same_output_whatever_the_global_generator() -> None:
    rates, returns = [0.2, 0.9, 1.0], np.arange(12.0).reshape(4, 3)
    np.random.seed(1)  # noqa: NPY002
    first = (rate_interval(rates), paired_difference(rates, rates), iqm_interval(returns))
    np.random.seed(2)  # noqa: NPY002
    second = (rate_interval(rates), paired_difference(rates, rates), iqm_interval(returns))
    assert first == second
    assert np.array_equal(first[1].lowered, second[1].lowered)


def test_batches_equal_single_calls() -> None:
    rates = np.random.default_rng(3).random((4, 6))
    batch = rate_posterior(rates, draws=1000)
    assert batch.shape == (1000, 4)
    for k in range(4):
        np.testing.assert_allclose(batch[:, k], rate_posterior(rates[k], draws=1000), atol=1e-14)


@pytest.mark.parametrize("lost", [0, 2])
def test_gaffke_s_test_is_exact_where_every_seed_gains_or_loses_all(lost: int) -> None:
    seeds = 8
    away = [1.0] * lost + [0.0] * (seeds - lost)
    found = paired_difference([1.0 - rate for rate in away], away)
    exact = sum(math.comb(seeds, k) for k in range(lost + 1)) / 2.0**seeds
    assert found.p_greater(weight=PROVEN) == pytest.approx(exact, rel=0.1)
    assert found.p_greater() < found.p_greater(weight=PROVEN)


def test_p_values_are_counted_and_never_zero() -> None:
    draws = np.array([-0.2, 0.1, 0.3, 0.5])
    difference = Difference(Estimate(0.0, 0.0, 0.0, 0.95), lambda worst, weight: draws)
    assert difference.p_greater(0.1) == pytest.approx(3 / 5)
    assert difference.p_greater() == pytest.approx(2 / 5)
    assert difference.p_less() == pytest.approx(4 / 5)
    clear = unpaired_difference([1.0] * 30, [0.0] * 30)
    assert clear.p_greater(0.2) == 1 / (DRAWS + 1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rate_interval([]), "at least one training seed"),
        (lambda: rate_interval([0.5, 1.2]), r"in \[0, 1\], got 1.2"),
        (lambda: rate_interval([0.5, float("nan")]), "got nan"),
        (lambda: rate_interval([0.5], 1.0), "level"),
        (lambda: rate_interval(np.ones((2, 2))), r"shape \(seeds,\), got \(2, 2\)"),
        (lambda: paired_difference([1.0], [1.0, 0.0]), "unpaired_difference"),
        (lambda: unpaired_difference([1.0], []), "transferred with at least one"),
        (lambda: unpaired_posterior([1.0], np.ones((2, 1))), "as many axes"),
        (lambda: p_equivalent([1.0], [1.0], 0.0), "margin > 0"),
        (lambda: iqm([]), "at least one value"),
        (lambda: iqm([1.0, float("inf")]), "finite values, got inf"),
        (lambda: iqm_interval([1.0, 2.0]), r"\(seeds, episodes\)"),
        (lambda: mean_interval(np.ones((2, 2))), r"\(seeds,\)"),
        (lambda: holm([0.5, 1.5]), r"p-values in \[0, 1\]"),
        (lambda: holm([float("nan")]), r"p-values in \[0, 1\]"),
        (lambda: holm(np.ones((1, 1))), r"shape \(m,\)"),
    ],
)
def test_bad_input_is_named(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


def test_holm_hand_worked() -> None:
    # Sorted: .005 × 4, .01 × 3, .03 × 2, .04 × 1 → .02, .03, .06, max(.06, .04).
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm([0.6, 0.9]), [1.0, 1.0])
    assert holm([0.04]).tolist() == [0.04]
    assert holm([]).shape == (0,)


@given(p=st.lists(st.floats(0.0, 1.0), max_size=10), data=st.data())
@fast
def test_holm_properties(p: list[float], data: st.DataObject) -> None:
    adjusted = holm(p)
    order = np.argsort(p, kind="stable")
    assert np.all(np.diff(adjusted[order]) >= 0.0)
    assert np.all(adjusted >= np.array(p))
    assert np.all(adjusted <= np.minimum(1.0, len(p) * np.array(p)))
    shuffle = data.draw(st.permutations(range(len(p))))
    assert holm([p[i] for i in shuffle]).tolist() == [adjusted[i] for i in shuffle]


def test_iqm_deletes_total_failures() -> None:
    assert iqm([1.0] * 6 + [0.0] * 2) == 1.0


def test_iqm_interval_agrees_with_all_resamples() -> None:
    values = np.array([[0.0, 1.0], [4.0, 6.0], [10.0, 11.0]])
    every = [iqm(values[list(rows)]) for rows in itertools.product(range(3), repeat=3)]
    found = iqm_interval(values, 0.8)
    assert found.estimate == iqm(values)
    assert found.low == pytest.approx(np.quantile(every, 0.1, method="inverted_cdf"))
    assert found.high == pytest.approx(np.quantile(every, 0.9, method="inverted_cdf"))


def test_iqm_interval_resamples_whole_seeds() -> None:
    rng = np.random.default_rng(5)
    values = rng.normal(size=(10, 1)) + 0.01 * rng.normal(size=(10, 50))
    whole, scattered = iqm_interval(values), iqm_interval(rng.permuted(values.ravel())[:, None])
    assert whole.high - whole.low > 3.0 * (scattered.high - scattered.low)


def test_iqm_interval_does_not_depend_on_seed_order() -> None:
    values = np.random.default_rng(6).normal(size=(7, 300))
    assert iqm_interval(values[::-1]) == iqm_interval(values)
    assert iqm_interval(values[:1]) is None


@pytest.mark.parametrize("size", [2, 30])
def test_mean_interval_is_student_t(size: int) -> None:
    values = np.concatenate((np.random.default_rng(size).normal(size=size), [np.nan, np.inf]))
    finite = values[:size]
    found = mean_interval(values, 0.9)
    low, high = stats.t.interval(0.9, size - 1, finite.mean(), stats.sem(finite))
    assert (found.estimate, found.low, found.high) == pytest.approx((finite.mean(), low, high))


def test_mean_interval_needs_two_finite_seeds() -> None:
    assert mean_interval([]) is None
    assert mean_interval([3.0, float("nan"), float("inf")]) is None
    assert mean_interval([3.0, 3.0]) == Estimate(3.0, 3.0, 3.0, 0.95)


flags = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=60)


@given(flags)
@settings(fast, max_examples=25)
def test_success_is_tested_exactly_and_the_interval_holds_the_difference(pairs):
    one, other = np.array(pairs, dtype=float).T
    interval, p = paired_success(one, other)
    assert interval.low <= interval.estimate <= interval.high
    assert interval.estimate == pytest.approx(one.mean() - other.mean())
    more, less = int((one > other).sum()), int((one < other).sum())
    exact = stats.binomtest(more, more + less).pvalue if more + less else 1.0
    assert p == pytest.approx(exact)


def test_one_policy_that_fails_elsewhere_is_shown_to():
    """0.975 at home and 0.10 elsewhere over 40 starts: no doubt about this policy."""
    home = np.array([1.0] * 39 + [0.0])
    away = np.array([1.0] * 4 + [0.0] * 36)
    interval, p = paired_success(home, away)
    assert 0.7 < interval.low < 0.875 < interval.high < 0.96
    assert p < 1e-6


def test_returns_are_compared_start_by_start():
    random = np.random.default_rng(0)
    starts = 100.0 * random.normal(size=30)
    interval, p = paired_return(starts + 1.0, starts + 0.1 * random.normal(size=30))
    assert 0.9 < interval.low < interval.high < 1.1
    assert p == pytest.approx(1e-4, rel=0.01)
    same, p = paired_return(starts, starts)
    assert (same.low, same.high, p) == (0.0, 0.0, 1.0)
    assert paired_return([1.0], [0.0])[0] is None


@pytest.mark.parametrize("wrong", [([1.0, 2.0], [1.0]), ([np.nan], [1.0]), ([], [])])
def test_returns_that_cannot_be_paired_are_refused(wrong):
    with pytest.raises(ValueError):
        paired_return(*wrong)


def test_the_random_signs_keep_their_level():
    random = np.random.default_rng(1)
    values = [paired_return(random.normal(size=12), np.zeros(12))[1] for _ in range(300)]
    assert np.mean(np.array(values) < 0.05) < 0.09


def test_draws_fit_the_memory():
    assert draws_for(10) == 200_000
    assert draws_for(10_000) == 1000
    assert draws_for(0) == 200_000


some_rates = st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)), min_size=2, max_size=12)


def _violation_by_loops(judged, true):
    worst = []
    for i in range(len(judged)):
        mistaken = [
            abs(true[i] - true[j])
            for j in range(len(judged))
            if (judged[i] < judged[j]) != (true[i] < true[j])
        ]
        worst.append(max(mistaken, default=0.0))
    return sum(worst) / len(worst)


@given(some_rates)
@settings(fast, max_examples=25)
def test_violation_is_what_loops_say(pairs):
    judged, true = np.array(pairs).T
    assert rank_violation(judged, true) == pytest.approx(_violation_by_loops(judged, true))


@given(some_rates, st.randoms(use_true_random=False))
@fast
def test_order_of_policies_does_not_matter(pairs, random):
    shuffled = random.sample(pairs, len(pairs))
    for measure in (rank_violation, pearson):
        one, other = (measure(*np.array(given_pairs).T) for given_pairs in (pairs, shuffled))
        assert one == pytest.approx(other, nan_ok=True, abs=1e-6)


def test_extremes():
    rates = np.array([0.1, 0.4, 0.9])
    assert rank_violation(rates, rates) == 0.0
    assert rank_violation(rates, rates**2) == 0.0
    assert rank_violation(rates, rates[::-1]) == pytest.approx((0.8 + 0.5 + 0.8) / 3)
    assert pearson(rates, 1.0 - rates) == pytest.approx(-1.0)
    assert math.isnan(pearson(np.ones(3), rates))


def test_intervals_hold_the_estimate_and_narrow_with_seeds():
    rng = np.random.default_rng(0)
    lengths = []
    for seeds in (8, 80):
        quality = rng.random(seeds)
        judged, true = (np.clip(quality + 0.1 * rng.standard_normal(seeds), 0, 1) for _ in "ab")
        correlation, violation = ranking_intervals(judged, true, np.arange(seeds))
        assert correlation.low <= correlation.estimate <= correlation.high
        assert correlation.estimate == pytest.approx(np.corrcoef(judged, true)[0, 1])
        assert 0.0 <= violation.low <= violation.estimate <= violation.high <= 1.0
        lengths.append(correlation.high - correlation.low)
    assert lengths[1] < lengths[0]


def test_policies_that_are_all_alike_have_no_correlation():
    correlation, violation = ranking_intervals(np.ones(6), np.linspace(0, 1, 6), np.arange(6) // 2)
    assert correlation is None
    assert violation.estimate > 0.0
