"""Results that others measured: intervals, comparisons and losses that need no simulation."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from msgspec.structs import replace

from integ_gym.support.errors import InputError
from integ_gym.support.terminal import fixed

from . import statistics as stats
from . import verdict
from .result_files import MEASURES, Row, Rows

STATUS_WORDS: Final = {
    "shown": "shown", "undecided": "not shown", "unsolved": "neither succeeds",
    "too_few_seeds": f"fewer than {verdict.MIN_SEEDS} each",
}  # fmt: skip
"""Of a difference; the last two are uninformative, as in `compare_policies`."""

Status: TypeAlias = Literal["shown", "undecided", "unsolved", "too_few_seeds"]


class Judged(stats.Part, frozen=True):
    """A policy in a condition; intervals are over seeds, or over the episodes of one seed."""

    policy: str
    condition: str
    seeds: int
    episodes: int
    estimates: dict[str, stats.Estimate]


class Compared(stats.Part, frozen=True, kw_only=True):
    """A difference, first minus second.

    Attributes:
        first, second: policies in a condition, or home and another condition of a policy.
        place: the condition, or the policy.
        measure: what is compared.
        means: of both.
        difference: with its 95 % interval.
        p: two-sided p-value.
        p_adjusted: after Holm's procedure over the informative comparisons of its kind.
        status: what it shows at the level of 0.05.
        difficulty: of a loss, what policies trained in the condition lose too; null: unknown.
        rest: of a loss, what is left: deadline and overfitting together.
    """

    first: str
    second: str
    place: str
    measure: str
    means: tuple[float, float]
    difference: stats.Estimate
    p: float
    p_adjusted: float
    status: Status
    difficulty: stats.Estimate | None = None
    rest: stats.Estimate | None = None


class Judgement(stats.Part, frozen=True):
    """Each policy in each condition, what differs between policies, and what is lost."""

    judged: tuple[Judged, ...]
    policies: tuple[Compared, ...]
    losses: tuple[Compared, ...]


def judge(rows: Rows, home: str | None = None) -> Judgement:
    """Judge episodes of which nothing but the outcome is known.

    Args:
        rows: of at least one policy; see `read_results`.
        home: condition that policies were trained in, where rows do not say it.

    Raises:
        ValueError: if a policy has several homes, or nothing was judged there.
    """
    cells: dict[tuple[str, str], list[Row]] = defaultdict(list)
    homes: dict[str, str] = {}
    for row in rows:
        cells[row["policy"], row["condition"]].append(row)
        own = row["home"] or home
        if own is not None and homes.setdefault(row["policy"], own) != own:
            raise InputError(f"{row['policy']} has the homes {homes[row['policy']]} and {own}")
    names, places = (list(dict.fromkeys(parts)) for parts in zip(*cells, strict=True))
    if unknown := sorted({*homes.values()} - {*places}):
        raise InputError(
            f"nothing was judged in {unknown[0]!r}; home is one of {', '.join(places)}"
        )
    pairs = [
        _compare(cells[a, place], cells[b, place], a, b, place)
        for place in places
        for a, b in itertools.combinations(names, 2)
        if {(a, place), (b, place)} <= {*cells}
    ]
    losses = [
        _lose(cells, homes, policy, place)
        for policy, place in list(cells)
        if homes.get(policy, place) != place and (policy, homes[policy]) in cells
    ]
    return Judgement(
        tuple(_judge_cell(*place, own) for place, own in cells.items()),
        _decide([one for one in pairs if one]),
        _decide([one for one in losses if one]),
    )


def by_seed(rows: Rows, measure: str) -> dict[Any, stats.Floats]:
    """Values of every training seed; empty where some were not measured."""
    found = defaultdict(list)
    for row in rows:
        found[row["seed"]].append(row[measure])
    whole = all(row[measure] is not None for row in rows)
    return {seed: np.array(own, dtype=np.float64) for seed, own in found.items()} if whole else {}


def units(rows: Rows, measure: str) -> stats.Floats:
    """Values of the units of replication: means of training seeds, or episodes of one seed."""
    seeds = list(by_seed(rows, measure).values())
    return seeds[0] if len(seeds) == 1 else np.array([stats.mean_of(own) for own in seeds])


def _judge_cell(policy: str, condition: str, rows: Rows) -> Judged:
    rates, returns = (units(rows, measure) for measure in MEASURES)
    known = {}
    if rates.size:
        known["success"] = stats.rate_interval(rates, draws=stats.draws_for(rates.size))
    if mean := stats.mean_interval(returns):
        known["return"] = mean
    return Judged(policy, condition, len({row["seed"] for row in rows}), len(rows), known)


def _compare(first: Rows, second: Rows, a: str, b: str, place: str) -> Compared | None:
    """A difference that is not adjusted yet; None where nothing was measured of both.

    Seeds of one policy in two conditions are paired; episodes are not, whose starts may differ.
    """
    for measure in MEASURES:
        one, other = units(first, measure), units(second, measure)
        if not (one.size and other.size):
            continue
        few = min(one.size, other.size) < verdict.MIN_SEEDS
        status: Status = "too_few_seeds" if few else "undecided"
        if measure == "success":
            cell = verdict.PolicyCell(place, one, other)
            status = verdict.uninformative(cell) or "undecided"
            draws = stats.draws_for(max(one.size, other.size))
            paired = _paired_seeds(first, second)
            found = (
                stats.paired_difference(*paired)
                if paired
                else stats.unpaired_difference(one, other, draws=draws)
            )
            interval, p = found.interval, min(1.0, 2.0 * min(found.p_greater(), found.p_less()))
        else:
            interval, p = stats.unpaired_return(one, other)
        return Compared(
            first=a, second=b, place=place, measure=measure,
            means=(stats.mean_of(one), stats.mean_of(other)),
            difference=interval, p=p, p_adjusted=p, status=status,
        )  # fmt: skip
    return None


def _paired_seeds(first: Rows, second: Rows) -> tuple[stats.Floats, stats.Floats] | None:
    """Rates of one policy's seeds in two conditions; None of two policies, or of one seed."""
    one, other = by_seed(first, "success"), by_seed(second, "success")
    if first[0]["policy"] != second[0]["policy"] or {*one} != {*other} or len(one) < 2:
        return None
    rates = [np.array([stats.mean_of(own[seed]) for seed in one]) for own in (one, other)]
    return rates[0], rates[1]


def _lose(
    cells: Mapping[tuple[str, str], Rows], homes: Mapping[str, str], policy: str, place: str
) -> Compared | None:
    """What a policy loses elsewhere; split where its seeds and natives are known."""
    own, away = cells[policy, homes[policy]], cells[policy, place]
    found, rates = _compare(own, away, homes[policy], place, policy), _paired_seeds(own, away)
    natives = [
        units(cells[other, place], "success")
        for other, its in homes.items()
        if its == place and (other, place) in cells
    ]
    if found is None or rates is None or not any(native.size for native in natives):
        return found
    loss = verdict.split(verdict.Rates(*rates, rates[1], np.concatenate(natives)))
    return replace(found, difficulty=loss.difficulty, rest=loss.overfitting)


def _decide(found: Sequence[Compared]) -> tuple[Compared, ...]:
    """The same with p-values adjusted over those that are informative, and what they show."""
    adjusted = iter(stats.holm([one.p for one in found if one.status == "undecided"]).tolist())
    decided = []
    for one in found:
        p = next(adjusted) if one.status == "undecided" else one.p
        shown = one.status == "undecided" and p < verdict.ALPHA
        decided.append(replace(one, p_adjusted=p, status="shown" if shown else one.status))
    return tuple(decided)


def answer_of(found: Judgement) -> str:
    """The answer in one sentence: the largest loss, else the clearest difference."""
    if found.losses:
        one = max(found.losses, key=lambda one: (one.measure, one.difference.estimate))
        return (
            f"{one.measure.title()} of {one.place} at home ({one.first}) {fixed(one.means[0])}, in "
            f"{one.second} {fixed(one.means[1])}, lost {_tested(one)}; whether dt is the cause "
            "takes a simulation."
        )
    if found.policies:
        one = min(found.policies, key=lambda one: (one.p_adjusted, -abs(one.difference.estimate)))
        return (
            f"{one.measure.title()} in {one.place}: {one.first} {fixed(one.means[0])}, "
            f"{one.second} {fixed(one.means[1])}, difference {_tested(one)}."
        )
    own = found.judged[0]
    words = [f"{name} {value.in_words(level=True)}" for name, value in own.estimates.items()]
    return f"{own.policy} in {own.condition}: {', '.join(words) or 'one return'}."


def _tested(one: Compared) -> str:
    words = one.difference.in_words(level=True, more=verdict.p_text(one.p_adjusted))
    return f"{words}: {STATUS_WORDS[one.status]}"


def limitations(found: Judgement) -> list[str]:
    """What the results cannot say, each in a sentence with what would."""
    single = sorted({one.policy for one in found.judged if one.seeds == 1})
    compared = (*found.policies, *found.losses)
    few = sorted({one.place for one in compared if one.status == "too_few_seeds"})
    split = [one for one in found.losses if one.rest]
    lines = {
        "Starts are not known to be the same, so a difference includes their luck. `integ-gym "
        "evaluate` shows which starts are lost, and tests pairs of them exactly.": True,
        "Why an episode failed, and whether dt is the cause, takes a simulation: `integ-gym "
        "evaluate` or `integ-gym check`.": True,
        f"Of {', '.join(single)} one training seed was judged: the intervals are over episodes "
        "and say nothing about other seeds.": single,
        f"Nothing is concluded in {', '.join(few)}: it takes {verdict.MIN_SEEDS} training seeds, "
        f"or {verdict.MIN_SEEDS} episodes of single ones.": few,
        "No home is known, so nothing is called a loss: give --home CONDITION, or a column home.":
        not found.losses,
        "A loss is split into a harder task and the rest only if several seeds were judged, and "
        "other policies were trained in that condition.": len(split) < len(found.losses),
        "No episode went beyond its horizon, so the rest includes what more time would win back.":
        split,
    }  # fmt: skip
    return [line for line, applies in lines.items() if applies]
