"""How operations are written: for floats with `math`, for arrays with NumPy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


class Unusual(ArithmeticError):
    """What a traced function took for granted does not hold; ask the plain one."""


@dataclass(frozen=True)
class Dialect:
    """Templates of what the worlds write differently.

    Attributes:
        names: what the source may refer to.
        negation: of a truth value.
        conjunction: of two.
        disjunction: of two.
        choice: {1} where {0} holds, else {2}.
        smaller: of {0}, which may not be a number, and {1}.
        larger: likewise.
        floor: of {0}.
        any: whether {0} holds in any lane.
        expectation: the statement that refuses to go on unless {0} holds.
        owned: template of a copy where entries of dictionaries must be objects of their own.
        lanes: whether components are arrays. Then no arithmetic raises; numbers are taken to be
            finite, so that 0.0 times one of them is 0.0, and the sign of a zero to mean nothing;
            and a loop goes on in the lanes where its condition holds, and in no other.
    """

    names: Mapping[str, Any]
    negation: str
    conjunction: str
    disjunction: str
    choice: str
    smaller: str
    larger: str
    floor: str
    any: str
    expectation: str
    owned: str
    lanes: bool


def _own(value: Any) -> Any:
    """A copy of an array; what is alike in all lanes may be one number, which needs none."""
    return value.copy() if isinstance(value, np.ndarray) else value


_SHARED = ("sin", "cos", "sqrt", "tanh", "isfinite", "inf", "nan")
_OF_ARRAYS = ("floor", "where", "minimum", "maximum", "logical_not")

SCALARS = Dialect(
    names={**{name: getattr(math, name) for name in _SHARED}, "Unusual": Unusual},
    negation="not {0}",
    conjunction="{0} and {1}",
    disjunction="{0} or {1}",
    choice="{1} if {0} else {2}",
    smaller="{0} if {0} <= {1} or {0} != {0} else {1}",
    larger="{0} if {0} >= {1} or {0} != {0} else {1}",
    floor="{0} // 1.0",
    any="{0}",
    expectation="if not {0}: raise Unusual",
    owned="{0}",
    lanes=False,
)

ARRAYS = Dialect(
    names={
        **{name: getattr(np, name) for name in (*_SHARED, *_OF_ARRAYS)},
        "any_lane": np.any,
        "all_lanes": np.all,
        "own": _own,
        "Unusual": Unusual,
    },
    negation="logical_not({0})",
    conjunction="{0} & {1}",
    disjunction="{0} | {1}",
    choice="where({0}, {1}, {2})",
    smaller="minimum({0}, {1})",
    larger="maximum({0}, {1})",
    floor="floor({0})",
    any="any_lane({0})",
    expectation="if not {0}.all(): raise Unusual",
    owned="own({0})",
    lanes=True,
)
