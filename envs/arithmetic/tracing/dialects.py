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
        anywhere: whether {0} holds in any lane.
        expectation: the statement that refuses to go on unless {0} holds.
        raises: whether arithmetic may raise.
        folds: whether numbers are taken to be finite, so that 0.0 times one of them is 0.0, and
            the sign of a zero to mean nothing.
        owned: template of a copy where entries of dictionaries must be objects of their own.
        masked: whether a loop goes on in the lanes where its condition holds, and in no other.
    """

    names: Mapping[str, Any]
    negation: str
    conjunction: str
    disjunction: str
    choice: str
    smaller: str
    larger: str
    floor: str
    anywhere: str
    expectation: str
    raises: bool
    folds: bool
    owned: str
    masked: bool


def _own(value: Any) -> Any:
    """A copy of an array; what is alike in all lanes may be one number, which needs none."""
    return value.copy() if isinstance(value, np.ndarray) else value


SCALARS = Dialect(
    names={
        "sin": math.sin,
        "cos": math.cos,
        "sqrt": math.sqrt,
        "tanh": math.tanh,
        "isfinite": math.isfinite,
        "inf": math.inf,
        "nan": math.nan,
        "Unusual": Unusual,
    },
    negation="not {0}",
    conjunction="{0} and {1}",
    disjunction="{0} or {1}",
    choice="{1} if {0} else {2}",
    smaller="{0} if {0} <= {1} or {0} != {0} else {1}",
    larger="{0} if {0} >= {1} or {0} != {0} else {1}",
    floor="{0} // 1.0",
    anywhere="{0}",
    expectation="if not {0}: raise Unusual",
    raises=True,
    folds=False,
    owned="{0}",
    masked=False,
)

ARRAYS = Dialect(
    names={
        **{name: getattr(np, name) for name in ("sin", "cos", "sqrt", "tanh", "floor", "isfinite")},
        "where": np.where,
        "minimum": np.minimum,
        "maximum": np.maximum,
        "logical_not": np.logical_not,
        "any_lane": np.any,
        "all_lanes": np.all,
        "own": _own,
        "inf": math.inf,
        "nan": math.nan,
        "Unusual": Unusual,
    },
    negation="logical_not({0})",
    conjunction="{0} & {1}",
    disjunction="{0} | {1}",
    choice="where({0}, {1}, {2})",
    smaller="minimum({0}, {1})",
    larger="maximum({0}, {1})",
    floor="floor({0})",
    anywhere="any_lane({0})",
    expectation="if not {0}.all(): raise Unusual",
    raises=False,
    folds=True,
    owned="own({0})",
    masked=True,
)
