"""How operations are written: for floats with `math`, for arrays with NumPy, for a browser."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .syntax import JAVASCRIPT_SYNTAX, PYTHON_SYNTAX, Syntax


class Unusual(ArithmeticError):
    """What a traced function took for granted does not hold; ask the plain one."""


@dataclass(frozen=True)
class Dialect:
    """What the worlds write differently.

    Attributes:
        names: what the source may refer to.
        written: templates of operations that are not written as a call of their name. `expect` is
            a statement, which refuses to go on unless {0} holds; `own` a copy, where
            entries of dictionaries must be objects of their own, and `own computed` the same of
            what was computed and not given; `and rarely` where {0} holds in few lanes, if in any.
        lanes: whether components are arrays. Then numbers are taken to be finite, so that 0.0
            times one of them is 0.0, and the sign of a zero to mean nothing; and a loop goes on in
            the lanes where its condition holds, and in no other.
        raises: whether arithmetic raises, as Python's does on floats.
        syntax: how statements are written.
    """

    names: Mapping[str, Any]
    written: Mapping[str, str]
    lanes: bool = False
    raises: bool = False
    syntax: Syntax = PYTHON_SYNTAX

    def operator(self, template: str) -> str:
        """How an operation that Python writes by ``template`` is written."""
        return self.written.get(template, template)

    def template(self, operation: str, count: int = 1) -> str:
        """How an operation on so many operands is written."""
        return self.written.get(operation, called(operation, count))

    def expected_after(self, limits: Sequence[float]) -> str:
        """How `expect` of lanes is written where sums of squares up to ``limits`` are enough.

        The operands are the condition and what is squared.
        """
        sums = (f"dot({{{k}}}, {{{k}}}) <= {limit!r}" for k, limit in enumerate(limits, 1))
        refusal = self.template("expect").removeprefix("if ")
        return f"if not ({' and '.join(sums)}) and {refusal}"


def called(name: str, count: int) -> str:
    """Template of a call with so many arguments."""
    return f"{name}({', '.join(f'{{{place}}}' for place in range(count))})"


def _own(value: Any) -> Any:
    """A copy of an array; what is alike in all lanes may be one number, which needs none."""
    return value.copy() if isinstance(value, np.ndarray) else value


_SHARED = ("sin", "cos", "sqrt", "tanh", "isfinite", "inf", "nan")
_OF_ARRAYS = ("floor", "where", "minimum", "maximum", "logical_not")

SCALARS = Dialect(
    names={**{name: getattr(math, name) for name in _SHARED}, "Unusual": Unusual},
    written={
        "logical_not": "not {0}",
        "and": "{0} and {1}",
        "or": "{0} or {1}",
        "where": "{1} if {0} else {2}",
        "minimum": "{0} if {0} <= {1} or {0} != {0} else {1}",
        "maximum": "{0} if {0} >= {1} or {0} != {0} else {1}",
        "floor": "{0} // 1.0",
        "any": "{0}",
        "expect": "if not {0}: raise Unusual",
        "own": "{0}",
        "own computed": "{0}",
    },
    raises=True,
)

ARRAYS = Dialect(
    names={
        **{name: getattr(np, name) for name in (*_SHARED, *_OF_ARRAYS)},
        "any_lane": np.any,
        "count_nonzero": np.count_nonzero,
        "dot": np.dot,
        "all_lanes": np.all,
        "own": _own,
        "Unusual": Unusual,
    },
    written={
        "and": "{0} & {1}",
        "or": "{0} | {1}",
        "any": "any_lane({0})",
        "expect": "if not {0}.all(): raise Unusual",
        "and rarely": "{0} & {1} if count_nonzero({0}) else {0}.copy()",
        "own computed": "{0}.copy()",
    },
    lanes=True,
)

JAVASCRIPT = Dialect(
    names={},
    written={
        **{name: f"Math.{name}({{0}})" for name in ("sin", "cos", "sqrt", "tanh", "floor", "abs")},
        "minimum": "Math.min({0}, {1})",
        "maximum": "Math.max({0}, {1})",
        "{0} % {1}": "((r, m) => (r && m < 0 !== r < 0 ? r + m : r))({0} % {1}, {1})",
        "{0} == {1}": "{0} === {1}",
        "{0} != {1}": "{0} !== {1}",
        "isfinite": "Number.isFinite({0})",
        "logical_not": "!{0}",
        "and": "{0} && {1}",
        "or": "{0} || {1}",
        "where": "{0} ? {1} : {2}",
        "any": "{0}",
        "expect": "if (!{0}) return null;",
        "own": "{0}",
        "own computed": "{0}",
    },
    syntax=JAVASCRIPT_SYNTAX,
)
