"""Numbers as they are stated: equal to every digit written; and tables that are written by hand."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from decimal import Decimal
from typing import TypeVar

import pytest

T = TypeVar("T")


def stated(text: str):
    """Whatever rounds to the number written.

    >>> 0.0741 == stated("0.07"), 0.0741 == stated("0.075")
    (True, False)
    """
    digit = Decimal(text).as_tuple().exponent
    return pytest.approx(float(text), rel=0, abs=0.5 * 10.0**digit)


def by_hand(table: Mapping[str, T], name: str, place: str) -> T:
    """The entry of a part that is registered; without one, what to add where."""
    assert name in table, f"{name!r} is registered: write its entry in {place} by hand"
    return table[name]


def check_table(table: Collection[str], registered: Iterable[str], place: str) -> None:
    """A table has an entry for every registered part and for nothing else."""
    missing, more = set(registered) - set(table), set(table) - set(registered)
    assert not missing, f"registered: {missing}; write their entries in {place} by hand"
    assert not more, f"{place} has {more}, and the registry has not"
