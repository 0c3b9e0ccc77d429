"""Discretizations and mixtures that the tables `train` and `evaluate` name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from integ_gym.envs.settings import WEIGHT, Discretization

from ..values import SpecError, check_keys, check_unique, list_of, many, positive, text
from .cell import DiscretizationMixture, Home
from .engines import INSTALLED, check_some_installed, on_installed


def trained(data: Mapping[str, Any], of: Discretization) -> tuple[Home, ...]:
    """Training discretizations and mixtures, in order.

    Args:
        data: of the specification.
        of: what has their control period, and the engine of those that name none.
    """
    found: list[Home] = []
    for entry in list_of(data, "train"):
        if isinstance(entry, Mapping) and "mixture" in entry:
            found.append(_mixture(entry, of))
        else:
            found += [member for member, _ in _expand("train", entry, of)]
    return tuple(dict.fromkeys(found))


def evaluated(data: Mapping[str, Any], of: Discretization) -> tuple[Discretization, ...]:
    """Discretizations of the grid, in order; on every installed engine where it asks for that.

    Args:
        data: of the specification.
        of: see :func:`trained`.

    Raises:
        SpecError: if it asks for installed engines, and there is none.
    """
    entries: list[Any] = []
    for entry in list_of(data, "evaluate"):
        entries += on_installed(entry) if asks_for_installed(entry) else [entry]
    found = [member for entry in entries for member, _ in _expand("evaluate", entry, of)]
    asked = [entry["map"] for entry in list_of(data, "evaluate") if asks_for_installed(entry)]
    if asked:
        check_some_installed(found, [name for maps in asked for name in many(maps)])
    return tuple(dict.fromkeys(found))


def asks_for_installed(entry: Any) -> bool:
    """Whether a table of `evaluate` is for every installed engine."""
    return isinstance(entry, Mapping) and entry.get("engine") == INSTALLED


def _mixture(entry: Mapping[str, Any], of: Discretization) -> DiscretizationMixture:
    """A table with a name and ``members``, whose weights hold for each that they expand to."""
    check_keys("key of a mixture in `train`", entry, ("mixture", "members"))
    name = text("mixture", entry["mixture"])
    members = [
        expanded
        for member in list_of(entry, "members")
        for expanded in _expand(f"members of {name}", member, of, (WEIGHT,))
    ]
    if len(members) < 2:
        raise SpecError(
            f"mixture {name!r} needs at least two `members`, got {len(members)}; a single "
            "discretization is trained on without a mixture"
        )
    check_unique(f"members of {name}", [member.name for member, _ in members])
    return DiscretizationMixture(name, tuple(members))


def _expand(
    key: str, entry: Any, of: Discretization, more: tuple[str, ...] = ()
) -> list[tuple[Discretization, float]]:
    """Discretizations of a table in which integrator and dt may be lists, with their weight."""
    if not isinstance(entry, Mapping):
        raise SpecError(
            f"every entry of `{key}` must be a table with `integrator` and `dt`, got {entry!r}"
        )
    check_keys(f"key in `{key}`", entry, ("integrator", "dt", "engine", *more))
    if "integrator" not in entry or "dt" not in entry:
        raise SpecError(f"every entry of `{key}` needs `integrator` and `dt`")
    engine = text("engine", entry.get("engine", of.engine))
    weight = positive(WEIGHT, entry.get(WEIGHT, 1.0))
    return [
        (
            replace(
                of, integrator=text("integrator", integrator), dt=positive("dt", dt), engine=engine
            ),
            weight,
        )
        for integrator in many(entry["integrator"])
        for dt in many(entry["dt"])
    ]
