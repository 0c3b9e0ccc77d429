"""How operations are written: for floats, for arrays, for a loop over lanes, for a browser."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..ops import SCALAR
from .symbols import NotTraceable
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
        finite: whether numbers are taken to be finite, so that 0.0 times one of them is 0.0, and
            the sign of a zero to mean nothing.
        lanes: whether components are arrays. Then a loop goes on in the lanes where its condition
            holds, and in no other.
        raises: whether arithmetic raises, as Python's does on floats.
        refused: operations of which it cannot be said what they come to, to the last bit.
        syntax: how statements are written.
    """

    names: Mapping[str, Any]
    written: Mapping[str, str]
    finite: bool = False
    lanes: bool = False
    raises: bool = False
    refused: frozenset[str] = frozenset()
    syntax: Syntax = PYTHON_SYNTAX

    def operator(self, template: str) -> str:
        """How an operation that Python writes by ``template`` is written.

        Raises:
            NotTraceable: if it is refused.
        """
        self._check(template)
        return self.written.get(template, template)

    def template(self, operation: str, count: int = 1) -> str:
        """How an operation on so many operands is written.

        Raises:
            NotTraceable: if it is refused.
        """
        self._check(operation)
        return self.written.get(operation, called(operation, count))

    def expected_after(self, limits: Sequence[float]) -> str:
        """How `expect` is written where sums of squares up to ``limits`` are enough.

        The operands are the condition and what is squared over all lanes.
        """
        if not self.lanes:
            return self.template("expect")
        sums = (f"dot({{{k}}}, {{{k}}}) <= {limit!r}" for k, limit in enumerate(limits, 1))
        refusal = self.template("expect").removeprefix("if ")
        return f"if not ({' and '.join(sums)}) and {refusal}"

    def _check(self, operation: str) -> None:
        if operation in self.refused:
            name = operation.format("x", "y")
            raise NotTraceable(f"`{name}` does not come to the same there")


def called(name: str, count: int) -> str:
    """Template of a call with so many arguments."""
    return f"{name}({', '.join(f'{{{place}}}' for place in range(count))})"


def _own(value: Any) -> Any:
    """A copy of an array; what is alike in all lanes may be one number, which needs none."""
    return value.copy() if isinstance(value, np.ndarray) else value


_SHARED = ("sin", "cos", "sqrt", "isfinite", "inf", "nan")
_OF_ARRAYS = ("floor", "where", "minimum", "maximum", "logical_not", "tanh")

SCALARS = Dialect(
    names={
        **{name: getattr(math, name) for name in _SHARED},
        "tanh": SCALAR.tanh,
        "Unusual": Unusual,
    },
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
    finite=True,
    lanes=True,
)

ONE_LANE = Dialect(
    names={**SCALARS.names, "floor": np.floor},
    written={
        **{name: SCALARS.written[name] for name in ("logical_not", "where", "minimum", "maximum")},
        **{name: ARRAYS.written[name] for name in ("and", "or")},
        "and rarely": "({0} & {1})",
        "expect": "usual &= {0}",
    },
    finite=True,
    refused=frozenset({"tanh", "{0} ** {1}", "any"}),
)
"""What stands in a loop over lanes; whether all is as expected is known at its end."""

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
