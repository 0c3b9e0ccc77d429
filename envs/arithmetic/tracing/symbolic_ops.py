"""The arithmetic of symbols."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..ops import SCALAR, Carry
from .symbols import NotTraceable, Symbol, check_numbers, is_boolean, same
from .trace import Trace


def _called(name: str, boolean: bool = False) -> Callable[[Any, Any], Any]:
    """A function of one number, as the dialect writes it; of a known one in the scalar world."""

    def call(self: SymbolicOps, x: Any, /) -> Any:
        if not isinstance(x, Symbol):
            return getattr(SCALAR, name)(x)
        if not boolean:
            check_numbers(x)
        return self._trace.note(self._trace.dialect.template(name), x, boolean=boolean)

    return call


class SymbolicOps:
    """The arithmetic of symbols; see :class:`integ_gym.envs.arithmetic.ops.Ops`."""

    epsilon = SCALAR.epsilon

    def __init__(self, trace: Trace) -> None:
        self._trace = trace

    sin, cos, sqrt, tanh = _called("sin"), _called("cos"), _called("sqrt"), _called("tanh")
    floor = _called("floor")
    isfinite, any = _called("isfinite", boolean=True), _called("any", boolean=True)

    def usually(self, condition: Any, /) -> Any:
        return self._trace.expect(condition)

    def rarely(self, condition: Any, /) -> Any:
        return self._trace.rarely(condition)

    def where(self, condition: Any, a: Any, b: Any, /) -> Any:
        if isinstance(condition, bool):
            return a if condition else b
        if same(a, b):
            return a
        boolean = is_boolean(a) and is_boolean(b)
        template = self._trace.dialect.template("where", 3)
        return self._trace.note(template, condition, a, b, boolean=boolean)

    def minimum(self, a: Any, b: Any, /) -> Any:
        return self._extreme("minimum", a, b)

    def maximum(self, a: Any, b: Any, /) -> Any:
        return self._extreme("maximum", a, b)

    def while_loop(
        self, condition: Callable[[Carry], Any], body: Callable[[Carry], Carry], carry: Carry
    ) -> Carry:
        return self._trace.loop(carry, lambda _, held: body(held), condition, 0)

    def repeat(self, count: int, body: Callable[[Any, Carry], Carry], carry: Carry) -> Carry:
        if count == 1:
            return body(0, carry)
        return self._trace.loop(carry, body, None, count)

    def foreign(
        self, function: Callable[..., Any], arguments: tuple[Any, ...], truths: tuple[bool, ...]
    ) -> tuple[Any, ...]:
        """One call that is made as it stands, and its results; of floats only."""
        if self._trace.dialect.lanes:
            raise NotTraceable("a call of floats is not traced for arrays")
        called = self._trace.call(function, arguments)
        return tuple(
            self._trace.note(f"{{0}}[{k}]", called, boolean=truth) for k, truth in enumerate(truths)
        )

    def _extreme(self, name: str, a: Any, b: Any) -> Any:
        if not isinstance(a, Symbol) and not isinstance(b, Symbol):
            return getattr(SCALAR, name)(a, b)
        if same(a, b):
            return a
        template = self._trace.dialect.template(name, 2)
        if not isinstance(a, Symbol) and a == a:
            template = template.replace(" or {0} != {0}", "")
        return self._trace.note(template, a, b, boolean=is_boolean(a) and is_boolean(b))
