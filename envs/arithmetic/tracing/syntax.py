"""How statements are written: in Python, and in JavaScript."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, Protocol


class Syntax(Protocol):
    """What the two languages write differently beyond single operations."""

    def constant(self, value: bool | int | float | str) -> str:
        """A number, truth value or text."""

    def named(self, name: str, expression: str) -> str:
        """A name that keeps its value."""

    def variable(self, name: str, expression: str) -> str:
        """A name that takes other values later."""

    def assigned(self, names: Sequence[str], values: Sequence[str]) -> list[str]:
        """Values taken all at once, as each may be made of any of the names."""

    def counting(self, index: str, count: int | str, body: Sequence[str]) -> list[str]:
        """A loop over 0 … count - 1."""

    def forever(self, body: Sequence[str]) -> list[str]:
        """A loop that is left by :meth:`leave_unless`."""

    def leave_unless(self, condition: str) -> str:
        """Leaves the loop where the condition does not hold."""

    def either(self, condition: str, then: Sequence[str], other: Sequence[str]) -> list[str]:
        """One of two blocks."""

    def together(self, parts: Sequence[str]) -> str:
        """A tuple, as a value or taken apart."""

    def entries(self, parts: Sequence[tuple[str, str]]) -> str:
        """A dictionary of (key, value)."""

    def function(self, arguments: Sequence[str], targets: Sequence[str], body: Sequence[str],
                 result: str) -> str:  # fmt: skip
        """A function that takes each argument apart into its target."""


class Python:
    """Statements of Python."""

    def constant(self, value: bool | int | float | str) -> str:
        return repr(value)

    def named(self, name: str, expression: str) -> str:
        return f"{name} = {expression}"

    variable = named

    def assigned(self, names: Sequence[str], values: Sequence[str]) -> list[str]:
        return [f"{', '.join(names)} = {', '.join(values)}"] if names else []

    def counting(self, index: str, count: int | str, body: Sequence[str]) -> list[str]:
        return [f"for {index} in range({count}):", *_indented(body or ["pass"])]

    def forever(self, body: Sequence[str]) -> list[str]:
        return ["while True:", *_indented(body)]

    def leave_unless(self, condition: str) -> str:
        return f"if not ({condition}): break"

    def either(self, condition: str, then: Sequence[str], other: Sequence[str]) -> list[str]:
        return [f"if {condition}:", *_indented(then), "else:", *_indented(other)]

    def together(self, parts: Sequence[str]) -> str:
        return "(" + "".join(f"{part}, " for part in parts) + ")"

    def entries(self, parts: Sequence[tuple[str, str]]) -> str:
        return "{" + ", ".join(f"{key!r}: {value}" for key, value in parts) + "}"

    def function(
        self, arguments: Sequence[str], targets: Sequence[str], body: Sequence[str], result: str
    ) -> str:
        lines = [f"{target} = {name}" for name, target in zip(arguments, targets, strict=True)]
        lines += [*body, f"return {result}"]
        return f"def traced({', '.join(arguments)}):\n" + "".join(f"    {line}\n" for line in lines)


class JavaScript:
    """Statements of JavaScript, not indented; tuples are arrays, and a function is an arrow."""

    def constant(self, value: bool | int | float | str) -> str:
        if isinstance(value, float) and not math.isfinite(value):
            return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
        return json.dumps(value)

    def named(self, name: str, expression: str) -> str:
        return f"const {name} = {expression};"

    def variable(self, name: str, expression: str) -> str:
        return f"let {name} = {expression};"

    def assigned(self, names: Sequence[str], values: Sequence[str]) -> list[str]:
        if len(names) < 2:
            return [f"{name} = {value};" for name, value in zip(names, values, strict=True)]
        return [f"[{', '.join(names)}] = [{', '.join(values)}];"]

    def counting(self, index: str, count: int | str, body: Sequence[str]) -> list[str]:
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


def _indented(lines: Sequence[str]) -> list[str]:
    return [f"    {line}" for line in lines]


PYTHON_SYNTAX: Syntax = Python()
JAVASCRIPT_SYNTAX: Syntax = JavaScript()


def tuple_of(names: Any) -> str:
    """Names in nested tuples, as Python writes them."""
    return PYTHON_SYNTAX.together([tuple_of(x) if isinstance(x, tuple) else x for x in names])
