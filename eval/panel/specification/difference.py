"""What a specification adds to the one that a directory was begun with, and what contradicts it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from integ_gym.envs.settings import Discretization
from integ_gym.support.terminal.formatting import plural

from .panel_spec import PanelSpec

GROWING: Final = "seeds"
"""List to which more may be added at the end."""

EPISODES: Final = ("episodes", "episode_parts")
"""How many starts there are, to which more may be added, and how many came at a time."""

WORDS: Final = ("question", "sources")
"""What may be another: words for people, and what follows from the lists."""


def additions(held: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """What is new in a specification that holds all of an earlier one, in words.

    Args:
        held: the earlier one, as plain data.
        now: the other.
    """
    for name in _LISTS:
        yield from _lacking(name, now, held)
    new = list(now.get(GROWING) or ())[len(held.get(GROWING) or ()) :]
    if new:
        yield f"{GROWING} {', '.join(map(str, new))}"
    more = sum(_parts(now)) - sum(_parts(held))
    if more:
        yield f"{plural(more, 'more episode')}{' a seed' if now.get(GROWING) else ''}"
    if held.get("question") != now.get("question"):
        yield "question"


def contradictions(held: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """What another specification lacks, or has otherwise, in words; nothing of seeds.

    Args:
        held: what a directory was begun with, as plain data.
        now: what is asked for there.
    """
    for name in _LISTS:
        for lost in _lacking(name, held, now):
            yield f"it has {lost}, which is missing now"
    one, other = _parts(held), _parts(now)
    differ = any(held.get(name) != now.get(name) for name in EPISODES)
    if differ and not (one and other[: len(one)] == one):
        yield f"`episodes` {_summed(one)} (now {_summed(other)})"
    same = {name: now.get(name) for name in (GROWING, *EPISODES, *WORDS, *_LISTS)}
    yield from _differences({**held, **same}, {**now, **same})


def continued(spec: PanelSpec, held: Mapping[str, Any]) -> PanelSpec:
    """The same panel with its episodes in the parts in which a directory has them, and then more.

    Args:
        spec: what is asked for there, unchanged if it says the parts itself or has fewer.
        held: what the directory was begun with, as plain data.
    """
    parts = _parts(held)
    more = spec.episodes - sum(parts)
    if spec.episode_parts or more < 0:
        return spec
    grown = (*parts, more) if more and parts else parts
    return replace(spec, episode_parts=grown if len(grown) > 1 else ())


def _parts(plan: Mapping[str, Any]) -> tuple[int, ...]:
    """How many episodes a plan has, in parts; none of one that is damaged."""
    told = plan.get("episode_parts") or [plan.get("episodes")]
    whole = isinstance(told, list) and all(type(part) is int for part in told)
    return tuple(told) if whole else ()


def _summed(parts: Sequence[int]) -> str:
    return " + ".join(map(str, parts)) or "none"


def _lacking(name: str, one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[str]:
    """Entries of a list that another specification's lacks; of a sweep, its values."""
    there = _by_entry(other.get(name) or ())
    for key, (entry, values) in _by_entry(one.get(name) or ()).items():
        if key not in there:
            yield _told(name, entry)
            continue
        missing = [value for value in values if value not in there[key][1]]
        if missing:
            yield _told(name, {**entry, "values": missing})


def _told(name: str, entry: Any) -> str:
    """An entry in words; as it is in a manifest that is damaged."""
    kind, words = _LISTS[name]
    try:
        return f"{kind} {words(entry)}"
    except (AttributeError, KeyError, TypeError, ValueError):
        return f"{kind} {json.dumps(entry)}"


def _by_entry(values: Sequence[Any]) -> dict[str, tuple[Any, tuple[float, ...]]]:
    """Entries of a list; of a sweep, which may have more values, these apart."""
    found = {}
    for value in values:
        swept = value.get("values", ()) if isinstance(value, dict) else ()
        entry = {k: x for k, x in value.items() if k != "values"} if swept else value
        found[json.dumps(entry, sort_keys=True)] = value, tuple(swept)
    return found


def _place(entry: Mapping[str, Any]) -> str:
    if "mixture" in entry:
        return repr(entry["mixture"])
    return f"{Discretization(**entry).name!r}"


def _changed(entry: Mapping[str, Any]) -> str:
    changes = ", ".join(f"{name} = {value}" for name, value in entry["environment"].items())
    return f"{entry['name']!r} ({changes})"


def _swept(entry: Mapping[str, Any]) -> str:
    return f"of `{entry['argument']}` at {', '.join(f'{value:g}' for value in entry['values'])}"


_LISTS: Final[Mapping[str, tuple[str, Callable[[Any], str]]]] = {
    "train": ("row", _place),
    "grid": ("cell", _place),
    "perturbations": ("perturbation", _changed),
    "sweeps": ("sweep", _swept),
    "baselines": ("baseline", repr),
}
"""Lists to which more may be added anywhere, what an entry is called, and how it is told."""


def _differences(held: Mapping[str, Any], now: Mapping[str, Any], of: str = "") -> Iterator[str]:
    """What differs between two specifications: numbers and texts as they were and are."""
    for key in {**held, **now}:
        one, other, name = held.get(key), now.get(key), f"{of}{key}"
        if one == other:
            continue
        if isinstance(one, dict) and isinstance(other, dict):
            yield from _differences(one, other, f"{name}.")
        elif isinstance(one, (dict, list)) or isinstance(other, (dict, list)):
            yield f"another `{name}`"
        else:
            yield f"`{name}` {one} (now {other})"
