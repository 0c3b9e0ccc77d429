"""How each world writes an operation: Python's floats, arrays, one lane, JavaScript."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .ops import SCALAR, NotTraceable, Unusual


class Python:
    """What the two languages write differently beyond single operations: in Python."""

    def constant(self, value: bool | int | float | str) -> str:
        """A number, truth value or text."""
        return repr(value)

    def named(self, name: str, expression: str) -> str:
        """A name that keeps its value."""
        return f"{name} = {expression}"

    def variable(self, name: str, expression: str) -> str:
        """A name that takes other values later."""
        return f"{name} = {expression}"

    def assign(self, names: Sequence[str], values: Sequence[str]) -> list[str]:
        """Values taken all at once, as each may be made of any of the names."""
        if len(names) <= _LONGEST:
            return [f"{', '.join(names)} = {', '.join(values)}"] if names else []
        cuts = range(0, len(names), _LONGEST)
        sides = ([self.together(side[k : k + _LONGEST]) for k in cuts] for side in (names, values))
        return [" = ".join(map(self.together, sides))]

    def count_loop(self, index: str, count: int | str, body: Sequence[str]) -> list[str]:
        """A loop over 0 … count - 1."""
        return [f"for {index} in range({count}):", *_indent(body or ["pass"])]

    def forever(self, body: Sequence[str]) -> list[str]:
        """A loop that is left by :meth:`leave_unless`."""
        return ["while True:", *_indent(body)]

    def leave_unless(self, condition: str) -> str:
        """Leaves the loop where the condition does not hold."""
        return f"if not ({condition}): break"

    def either(self, condition: str, then: Sequence[str], other: Sequence[str]) -> list[str]:
        """One of two blocks."""
        return [f"if {condition}:", *_indent(then), "else:", *_indent(other)]

    def together(self, parts: Sequence[str]) -> str:
        """A tuple, as a value or taken apart."""
        return "(" + "".join(f"{part}, " for part in parts) + ")"

    def entries(self, parts: Sequence[tuple[str, str]]) -> str:
        """A dictionary of (key, value)."""
        return "{" + ", ".join(f"{key!r}: {value}" for key, value in parts) + "}"

    def function(
        self, arguments: Sequence[str], targets: Sequence[str], body: Sequence[str], result: str
    ) -> str:
        """A function that takes each argument apart into its target."""
        lines = [f"{target} = {name}" for name, target in zip(arguments, targets, strict=True)]
        lines += [*body, f"return {result}"]
        return f"def traced({', '.join(arguments)}):\n" + "".join(f"    {line}\n" for line in lines)


_LONGEST = 30
"""Entries of a tuple that Python makes without a list, which Numba does not turn into a tuple."""


class JavaScript(Python):
    """Statements of JavaScript, not indented; tuples are arrays, and a function is an arrow."""

    def constant(self, value: bool | int | float | str) -> str:
        if isinstance(value, float) and not math.isfinite(value):
            return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
        return json.dumps(value)

    def named(self, name: str, expression: str) -> str:
        return f"const {name} = {expression};"

    def variable(self, name: str, expression: str) -> str:
        return f"let {name} = {expression};"

    def assign(self, names: Sequence[str], values: Sequence[str]) -> list[str]:
        if len(names) < 2:
            return [f"{name} = {value};" for name, value in zip(names, values, strict=True)]
        return [f"[{', '.join(names)}] = [{', '.join(values)}];"]

    def count_loop(self, index: str, count: int | str, body: Sequence[str]) -> list[str]:
        return [f"for (let {index} = 0; {index} < {count}; {index} += 1) {{", *body, "}"]

    def forever(self, body: Sequence[str]) -> list[str]:
        return ["for (;;) {", *body, "}"]

    def leave_unless(self, condition: str) -> str:
        return f"if (!({condition})) break;"

    def either(self, condition: str, then: Sequence[str], other: Sequence[str]) -> list[str]:
        return [f"if ({condition}) {{", *then, "} else {", *other, "}"]

    def together(self, parts: Sequence[str]) -> str:
        return f"[{', '.join(parts)}]"

    def entries(self, parts: Sequence[tuple[str, str]]) -> str:
        return "{" + ", ".join(f"{json.dumps(key)}: {value}" for key, value in parts) + "}"

    def function(
        self, arguments: Sequence[str], targets: Sequence[str], body: Sequence[str], result: str
    ) -> str:
        lines = [*body, f"return {result};"]
        return f"({', '.join(targets)}) => {{\n" + "".join(f"{line}\n" for line in lines) + "}"


def _indent(lines: Sequence[str]) -> list[str]:
    return [f"    {line}" for line in lines]


PYTHON_SYNTAX = Python()


def tuple_of(names: Any) -> str:
    """Names in nested tuples, as Python writes them."""
    return PYTHON_SYNTAX.together([tuple_of(x) if isinstance(x, tuple) else x for x in names])


@dataclass(frozen=True)
class Dialect:
    """What the worlds write differently.

    Attributes:
        names: what the source may refer to.
        written: templates of operations that are not written as a call of their name. `expect` is
            a statement, which refuses to go on unless {0} holds; `own` a copy, where
            entries of dictionaries must be objects of their own, and `own computed` the same of
            what was computed and not given; `and false` where {0} holds in few lanes, if in any.
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
    syntax: Python = PYTHON_SYNTAX

    def operator(self, template: str) -> str:
        """How an operation that Python writes by ``template`` is written.

        Raises:
            NotTraceable: if it is refused.
        """
        if template in self.refused:
            name = template.format("x", "y")
            raise NotTraceable(f"`{name}` does not come to the same there")
        return self.written.get(template, template)

    def template(self, operation: str, count: int = 1) -> str:
        """How an operation on so many operands is written; refused as by :meth:`operator`."""
        self.operator(operation)
        return self.written.get(operation, call_template(operation, count))

    def expected_after(self, limits: Sequence[float]) -> str:
        """How `expect` is written where sums of squares up to ``limits`` are enough.

        The operands are the condition and what is squared over all lanes.
        """
        if not self.lanes:
            return self.template("expect")
        sums = (f"dot({{{k}}}, {{{k}}}) <= {limit!r}" for k, limit in enumerate(limits, 1))
        refusal = self.template("expect").removeprefix("if ")
        return f"if not ({' and '.join(sums)}) and {refusal}"


def call_template(name: str, count: int) -> str:
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
        "and false": "{0} & {1} if count_nonzero({0}) else {0}.copy()",
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
        "and false": "({0} & {1})",
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
    syntax=JavaScript(),
)


def target(syntax: Python, value: Any) -> str:
    """Left side of the assignment that takes an argument apart."""
    if isinstance(value, tuple):
        return syntax.together([target(syntax, part) for part in value])
    return str(value.name)
