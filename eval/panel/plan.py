"""A run's plan beside its specification: how it grows, how two differ, what its seeds can show."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, get_type_hints

import msgspec

from integ_gym.envs.registries import TRUTH
from integ_gym.envs.settings import DISCRETIZATION, Discretization
from integ_gym.support.parameters import texts_of
from integ_gym.support.terminal import plural

from ..power import Power, fewest_seeds, verdict_chances
from ..verdict import ALPHA, Looks, Shares
from .cells import (
    UNNAMED,
    Cell,
    DiscretizationMixture,
    Home,
    SpecError,
    changes_name,
    convert,
    flatten,
    training_homes,
)
from .result import Look
from .spec import LATER, NO_RESULT, TRAINERS, PanelSpec

_CODE = ("env_id", "environment", "train", "grid")
"""Parts whose texts may name code of somebody's own."""


def read_planned_spec(plan: Mapping[str, Any]) -> PanelSpec:
    """The panel, or the evaluation, that a run's plan describes; no code that it names is loaded.

    Args:
        plan: the `specification` of a run's manifest.

    Raises:
        SpecError: if it is no plan of a panel, in one sentence.
    """
    try:
        kinds = get_type_hints(PanelSpec, include_extras=True)
        kinds |= {"trainer": dict[str, str | None], "train": list[dict[str, Any]]}
        fields = [n for n in kinds if n not in NO_RESULT and (n in plan or n not in LATER)]
        known = {name: convert(name, plan[name], kinds[name]) for name in fields}
        period = known["control_period"]
        known["train"] = training_homes(known["train"], Discretization(TRUTH, period, period))
        known["trainer"] = known["trainer"].get("name")
        if known["trainer"] not in TRAINERS:
            raise SpecError("it names no trainer that there is")
        spec = PanelSpec(**known)
        if spec.episode_parts and sum(spec.episode_parts) != spec.episodes:
            raise SpecError("`episode_parts` do not add up")
    except (KeyError, SpecError, msgspec.ValidationError) as error:
        raise SpecError(f"its specification is damaged: {error}") from None
    return spec


def read_planned_home(plan: Mapping[str, Any]) -> Home | None:
    """What the policy of an evaluation was trained on, as stated to its run; None: unknown.

    Raises:
        SpecError: if the plan does not say.
    """
    try:
        members = msgspec.convert(plan["home"]["discretizations"], list[Discretization] | None)
        if not members or len(members) == 1:
            return members[0] if members else None
        shares = msgspec.convert(plan["home"]["shares"], list[float])
        return DiscretizationMixture(UNNAMED, tuple(zip(members, shares, strict=True)))
    except (KeyError, TypeError, ValueError, msgspec.ValidationError) as error:
        raise SpecError(f"its `home` is damaged: {error}") from None


def names_code(plan: Mapping[str, Any]) -> bool:
    """Whether a plan names code of somebody's own, as ``"module:Name"``."""
    return any(":" in text for part in _CODE for text in texts_of(plan.get(part)))


GROWING: Final = "seeds"
"""List to which more may be added at the end."""

MAY_DIFFER: Final = (GROWING, "episodes", "episode_parts", "question", "sources", "unmade")
"""What grows, words for people, and what follows from the lists."""


def additions(held: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """What is new in a specification that holds all of an earlier one, in words.

    Args:
        held: the earlier one, as plain data.
        now: the other.
    """
    yield from _missing_entries(now, held)
    if new := list(now.get(GROWING) or ())[len(held.get(GROWING) or ()) :]:
        yield f"{GROWING} {', '.join(map(str, new))}"
    if more := sum(_episode_parts(now)) - sum(_episode_parts(held)):
        yield f"{plural(more, 'more episode')}{' a seed' if now.get(GROWING) else ''}"
    if held.get("question") != now.get("question"):
        yield "question"


def contradictions(held: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """What another specification lacks, or has otherwise, in words; nothing of seeds.

    Args:
        held: what a directory was begun with, as plain data.
        now: what is asked for there.
    """
    for lost in _missing_entries(held, now):
        yield f"it has {lost}, which is missing now"
    one, other = _episode_parts(held), _episode_parts(now)
    if other[: len(one)] != one or (other and not one):
        yield f"`episodes` {_sum_words(one)} (now {_sum_words(other)})"
    same = {name: now.get(name) for name in (*MAY_DIFFER, *_LISTS)}
    yield from _differences({**held, **same}, {**now, **same})


def with_episode_parts(spec: PanelSpec, held: Mapping[str, Any]) -> PanelSpec:
    """The same panel with its episodes in the parts in which a directory has them, and then more.

    Args:
        spec: what is asked for there, unchanged if it says the parts itself or has fewer.
        held: what the directory was begun with, as plain data.
    """
    parts = _episode_parts(held)
    more = spec.episodes - sum(parts)
    if spec.episode_parts or more < 0:
        return spec
    grown = (*parts, more) if more and parts else parts
    return replace(spec, episode_parts=grown if len(grown) > 1 else ())


def _episode_parts(plan: Mapping[str, Any]) -> tuple[int, ...]:
    """How many episodes a plan has, in parts; none of one that is damaged."""
    parts = plan.get("episode_parts") or [plan.get("episodes")]
    whole = isinstance(parts, list) and all(type(part) is int for part in parts)
    return tuple(parts) if whole else ()


def _sum_words(parts: Sequence[int]) -> str:
    return " + ".join(map(str, parts)) or "none"


def _missing_entries(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[str]:
    """Entries of lists that another specification's lack, in words."""
    for name, kind in _LISTS.items():
        there = [json.dumps(entry, sort_keys=True) for entry in other.get(name) or ()]
        for entry in one.get(name) or ():
            if json.dumps(entry, sort_keys=True) not in there:
                yield f"{kind} {_entry_words(entry)}"


def _entry_words(entry: Any) -> str:
    """An entry in words; as it is in a manifest that is damaged."""
    try:
        if "changes" in entry:
            return f"{entry['name']!r} ({changes_name(entry['changes'])})"
        if "dt" in entry:
            return repr(Discretization(**{name: entry[name] for name in DISCRETIZATION}).name)
        return repr(entry if isinstance(entry, str) else entry["mixture"])
    except (AttributeError, KeyError, TypeError, ValueError):
        return json.dumps(entry)


_LISTS: Final[Mapping[str, str]] = {
    "train": "row",
    "grid": "cell",
    "variations": "variation",
    "baselines": "baseline",
    "limit": "step of the limit",
}
"""Lists to which more may be added anywhere, and what an entry is called."""


def _differences(held: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """What differs between two specifications: numbers and texts as they were and are."""
    before, after = dict(flatten(held)), dict(flatten(now))
    for name in {**before, **after}:
        one, other = before.get(name), after.get(name)
        if one != other:
            listed = isinstance(one, list) or isinstance(other, list)
            yield f"another `{name}`" if listed else f"`{name}` {one} (now {other})"


STAGES: Final = (4, 12)
"""Training seeds after which a page is written, while more are to come."""

FREE: Final = (
    *("question", "seeds", "exploratory_seeds", "train", "grid", "variations"),
    *("baselines", "family", "compare", "looks", "ladder", "limit", "sources", "unmade"),
)
"""Parts of a specification that no record of a policy in a cell depends on."""

MOST_SEEDS: Final = 10_000
"""Seeds that a panel may have."""


def with_seed_count(spec: PanelSpec, seeds: int) -> PanelSpec:
    """The same panel with so many training seeds: its first, or all and new ones after the last.

    Raises:
        SpecError: for less than one, more than 10 000, or a panel without training.
    """
    if not spec.seeds:
        raise SpecError(f"panel {spec.name!r} trains nothing, so it has no seeds to add to")
    if not 1 <= seeds <= MOST_SEEDS:
        raise SpecError(f"a panel takes 1 to {MOST_SEEDS} seeds, got {seeds}")
    new = range(max(spec.seeds) + 1, max(spec.seeds) + 1 + seeds - len(spec.seeds))
    return replace(spec, seeds=(*spec.seeds[:seeds], *new))


def stages(spec: PanelSpec) -> tuple[PanelSpec, ...]:
    """The panel with its first seeds alone, with more, and whole.

    A stage that is more than half of what follows is left out: it would come no sooner.
    """
    counts = [count for count in STAGES if 2 * count < len(spec.seeds)]
    return (*(replace(spec, seeds=spec.seeds[:count]) for count in counts), spec)


def inputs(spec: PanelSpec, cells: Iterable[Cell]) -> dict[str, Any]:
    """What records in some cells depend on, beside the policies: nothing that may be added.

    Args:
        spec: the panel.
        cells: of the records.
    """
    values = spec.to_json()
    places = [(cell.name, cell.discretization.arguments(), cell.environment) for cell in cells]
    used = {place["integrator"] for _, place, _ in places}
    sources = {name: source for name, source in values["sources"].items() if name in used}
    shared = {name: value for name, value in values.items() if name not in FREE}
    shared |= {"start_sets": list(spec.start_sets), "cells": sorted(places)}
    return {**shared, "sources": sources}


def family_power(
    spec: PanelSpec, before: Sequence[Look]
) -> tuple[int, int, tuple[Power, ...], int]:
    """Power of a panel's declared transfers, simulated.

    Args:
        spec: the panel, which declares some.
        before: earlier looks at its verdicts.

    Returns:
        The fewest seeds of the rows that they name, and of the rows that were trained in cells that
        they name; power by true overfitting; and the seeds with which `transfers` can be shown
        where every episode succeeds.
    """
    seen = (
        Shares(look.level_exceeds / ALPHA, look.level_equivalent / ALPHA)
        if look.adopted
        else look.seeds
        for look in before
    )
    looks = Looks(tuple(seen), spec.looks)
    counts = {spec.name_of(home): len(spec.seeds_of(home)) for home in spec.train}
    seeds = min(counts[row] for row, _ in spec.family)
    natives = min((counts[cell] for _, cell in spec.family if cell in counts), default=0)
    found = verdict_chances(seeds, natives, spec.episodes, len(spec.family), looks)
    return seeds, natives, found, fewest_seeds(len(spec.family), looks)
