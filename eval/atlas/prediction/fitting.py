"""A number that predicts what a policy loses on the truth, or one for each part of it.

A loss is predicted by a nondecreasing function of one number, or by the sum of several, each of its
own: the least-squares fit over the points that may be seen (additive isotonic regression:
Bacchetti, Journal of the American Statistical Association 84 (1989) 289-294). Its interval covers
as many of their residuals, each left out of its own fit with all points of its limit, as the level
says (the jackknife by groups: Barber, Candès, Ramdas and Tibshirani, Annals of Statistics 49 (2021)
486-507): apart where the numerics do next to nothing, where little is expected to be lost, and
where more is (Mondrian prediction: Vovk, Gammerman and Shafer, Algorithmic Learning in a Random
World, 2005, section 4.5).
Numbers are rounded to 9 decimals, so that a law is the same whichever processor it was fitted on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
import numpy.typing as npt

from ...statistics import paired_difference
from ..numbers import Quantities, terms_of
from ..summaries import Point

Array = npt.NDArray[np.float64]

LEVEL: Final = 0.9
"""Of the interval of a prediction."""

QUIET: Final = 0.03
"""Force of the numerics over the motor's up to which they do next to nothing."""

LITTLE: Final = 0.05
"""Loss up to which little is expected to be lost."""

DRAWS: Final = 2000
"""Resamples of the training grounds, for the interval of an error."""

DECIMALS: Final = 9

SWEEPS: Final = 200
"""Rounds over the numbers of a sum, at most; they end sooner where nothing changes any more."""


class Line(msgspec.Struct, frozen=True):
    """A nondecreasing function of one number, constant beyond its ends.

    Attributes:
        at: numbers, ascending.
        loss: at each, or the part of it that goes by the number.
    """

    at: tuple[float, ...]
    loss: tuple[float, ...]

    def __call__(self, numbers: float | Array) -> Array:
        """What is to be expected at numbers, of their shape."""
        return np.asarray(np.interp(np.asarray(numbers), self.at, self.loss))


class Curve(msgspec.Struct, frozen=True):
    """The loss that is to be expected, by a number or by the sum of what goes by several.

    Attributes:
        number: name of a candidate or a guess.
        lines: of its terms.
        half_widths: of the interval of a prediction: where the numerics' force is at most `QUIET`,
            where at most `LITTLE` is expected to be lost, and where more is.
        seen_error: mean of the absolute error over the points of the fit, each predicted from the
            other limits of the control.
    """

    number: str
    lines: tuple[Line, ...]
    half_widths: tuple[float, float, float]
    seen_error: float

    def __call__(self, quantities: Quantities) -> float:
        """Loss that is to be expected, at most 1."""
        return min(sum(self.parts(quantities).values()), 1.0)

    def half_width(self, force: float | Array, expected: float | Array) -> Array:
        """Of intervals around what is expected at forces of the numerics, of their shape."""
        return np.asarray(self.half_widths)[_groups(force, expected)]

    def parts(self, quantities: Quantities) -> dict[str, float]:
        """What is to be expected of each part, by its name."""
        terms = zip(terms_of(self.number), self.lines, strict=True)
        return {term.part: float(line(term.number(quantities))) for term, line in terms}


@dataclass(frozen=True)
class Trial:
    """How well a number predicts losses that its fit has not seen.

    Attributes:
        number: its name.
        error: mean of the absolute error over the held-out points.
        low: of its 95 % interval over training grounds.
        high: the same.
        seen_error: of the curve, see :class:`Curve`.
        covered: share of the held-out losses within their intervals.
        with_chance: the same, with intervals widened by what a mean over the seeds may be off.
        points: held out.
        more: the error less that of the first number that was tried on the same points.
        more_low: of its 95 % interval over training grounds.
        more_high: the same.
    """

    number: str
    error: float
    low: float
    high: float
    seen_error: float
    covered: float
    with_chance: float
    points: int
    more: float
    more_low: float
    more_high: float


def fit(name: str, seen: Sequence[Point]) -> Curve:
    """The curve of one number over single discretizations in which the task was learned.

    Raises:
        ValueError: if there are none.
    """
    learned = telling(seen)
    if not learned:
        raise ValueError("no policy learned its task in any of the points")
    force, expected, found = np.array(list(_from_other_limits(name, learned))).T
    groups, residuals = _groups(force, expected), abs(found - expected)
    quiet, little, more = (_half_width(residuals, groups == group) for group in range(3))
    error = round(float(residuals.mean()), DECIMALS)
    return _curve(name, learned, (quiet, little, more), error)


def _from_other_limits(name: str, learned: Sequence[Point]) -> Iterator[tuple[float, float, float]]:
    """Force, the loss expected by a fit to the other limits, where there are, and that found."""
    for ratio in sorted({point.ratio for point in learned}):
        others = _curve(name, [point for point in learned if point.ratio != ratio] or learned)
        for point in learned:
            if point.ratio == ratio:
                yield point.known.force, others(point.known), point.loss


def _groups(force: float | Array, expected: float | Array) -> npt.NDArray[np.intp]:
    """Which of the half widths are those of predictions."""
    loud = np.where(np.asarray(expected) <= LITTLE, 1, 2)
    return np.where(np.asarray(force) <= QUIET, 0, loud)


def _half_width(residuals: Array, of: npt.NDArray[np.bool_]) -> float:
    """That of some residuals; of all, where there are none of these."""
    own = residuals[of] if of.any() else residuals
    return round(float(np.quantile(own, LEVEL, method="higher")), DECIMALS)


def telling(found: Sequence[Point]) -> list[Point]:
    """Those whose loss a number may predict: single discretizations that were learned in."""
    return [point for point in found if point.learned and point.quantities is not None]


def off_by_chance(point: Point) -> float:
    """Half the width of a loss's interval over its seeds, of `LEVEL`.

    It is that of the difference of both success rates, over the rate at home: positive, even where
    all seeds agree.
    """
    lost = paired_difference(point.at_home, point.on_truth, LEVEL).interval
    return 0.5 * (lost.high - lost.low) / float(point.at_home.mean())


def errors_of(curve: Curve, found: Sequence[Point]) -> Array:
    """Absolute errors of what a curve expects of points, shape (points,)."""
    return np.array([abs(point.loss - curve(point.known)) for point in found])


def trials(curves: Sequence[Curve], held_out: Sequence[Point]) -> tuple[Trial, ...]:
    """Curves' predictions against losses that they have not seen, beside those of the first.

    Args:
        curves: fitted without them.
        held_out: points that tell something, at least one.
    """
    homes = np.array([point.home.name for point in held_out])
    losses = np.array([point.loss for point in held_out])
    force = np.array([point.known.force for point in held_out])
    off = np.array([off_by_chance(point) for point in held_out])
    found, first = [], None
    for curve in curves:
        expected = np.array([curve(point.known) for point in held_out])
        widths = curve.half_width(force, expected)
        errors = abs(losses - expected)
        first = errors if first is None else first
        found.append(
            Trial(
                curve.number,
                float(errors.mean()),
                *_resampled(errors, homes),
                curve.seen_error,
                float((errors <= widths).mean()),
                float((errors <= np.hypot(widths, off)).mean()),
                len(held_out),
                float((errors - first).mean()),
                *_resampled(errors - first, homes),
            )
        )
    return tuple(found)


def _curve(
    name: str,
    learned: Sequence[Point],
    widths: tuple[float, float, float] = (np.inf, np.inf, np.inf),
    error: float = np.nan,
) -> Curve:
    """Fitted to points in turn by each number, to what the others leave."""
    losses = np.array([point.loss for point in learned])
    numbers = [
        np.array([term.number(point.known) for point in learned]).round(DECIMALS)
        for term in terms_of(name)
    ]
    parts = np.zeros((len(numbers), len(losses)))
    for _ in range(SWEEPS):
        before = parts.copy()
        for place, own in enumerate(numbers):
            parts[place] = _never_falling(own, losses - parts.sum(axis=0) + parts[place])
        if np.allclose(parts, before, rtol=0.0, atol=10.0**-DECIMALS):
            break
    least = parts[1:].min(axis=1, keepdims=True)  # is told with the first
    parts[0] += least.sum()
    parts[1:] -= least
    lines = (_line(own, part) for own, part in zip(numbers, parts, strict=True))
    return Curve(name, tuple(lines), widths, error)


def _never_falling(numbers: Array, losses: Array) -> Array:
    """The fit to losses, one at each number."""
    from scipy.optimize import isotonic_regression

    _, places = np.unique(numbers, return_inverse=True)
    counts = np.bincount(places).astype(float)
    means = np.bincount(places, weights=losses) / counts
    fitted: Array = isotonic_regression(means, weights=counts).x[places]
    return fitted


def _line(numbers: Array, fitted: Array) -> Line:
    """Numbers, ascending and each once, with what was fitted at each."""
    at, first = np.unique(numbers, return_index=True)
    return Line(tuple(at.tolist()), tuple(fitted[first].round(DECIMALS).tolist()))


def _resampled(errors: Array, homes: npt.NDArray[np.str_]) -> tuple[float, float]:
    """95 % interval of the mean error over training grounds drawn anew."""
    generator = np.random.default_rng(0)
    names, places = np.unique(homes, return_inverse=True)
    sums = np.bincount(places, weights=errors)
    counts = np.bincount(places)
    drawn = generator.integers(len(names), size=(DRAWS, len(names)))
    means = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)
