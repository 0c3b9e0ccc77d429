"""Arithmetic on CasADi's expressions."""

from __future__ import annotations

import math
import operator
import sys
from collections.abc import Callable
from typing import Any, NoReturn

from integ_gym.support.errors import InputTypeError
from integ_gym.support.optional import load

from ..ops.ops import SCALAR, Component, keep_condition, repeat

casadi = load("casadi", "casadi")


def plain(x: Component) -> Any:
    """What CasADi takes for a component: its own symbols, and numbers."""
    return x.sx if isinstance(x, Expression) else x


def _note(function: Callable[..., Any]) -> Callable[..., Expression]:
    return lambda *operands: Expression(function(*map(plain, operands)))


def _reflect(function: Callable[..., Any]) -> Callable[..., Expression]:
    return lambda a, b: Expression(function(plain(b), plain(a)))


class Expression:
    """A scalar `casadi.SX` with all the operators of a component; SX has no ``&`` and ``|``."""

    __slots__ = ("sx",)
    __array_ufunc__ = None
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, sx: Any) -> None:
        self.sx = sx

    def __bool__(self) -> bool:
        raise InputTypeError(
            "a component has no truth value while its equations are written; use ops.where"
        )

    __add__, __radd__ = _note(operator.add), _reflect(operator.add)
    __sub__, __rsub__ = _note(operator.sub), _reflect(operator.sub)
    __mul__, __rmul__ = _note(operator.mul), _reflect(operator.mul)
    __truediv__, __rtruediv__ = _note(operator.truediv), _reflect(operator.truediv)
    __mod__, __rmod__ = _note(operator.mod), _reflect(operator.mod)
    __pow__, __rpow__ = _note(operator.pow), _reflect(operator.pow)
    __neg__, __pos__, __abs__ = _note(operator.neg), _note(operator.pos), _note(casadi.fabs)
    __lt__, __le__ = _note(operator.lt), _note(operator.le)
    __gt__, __ge__ = _note(operator.gt), _note(operator.ge)
    __eq__, __ne__ = _note(operator.eq), _note(operator.ne)  # type: ignore[assignment]
    __and__ = __rand__ = _note(casadi.logic_and)
    __or__ = __ror__ = _note(casadi.logic_or)


def _unary(name: str) -> Callable[[Component], Component]:
    """A function of one expression, or of a number."""

    def call(x: Component, /) -> Component:
        if isinstance(x, Expression):
            return Expression(getattr(casadi, name)(x.sx))
        return getattr(SCALAR, name)(x)

    return call


class CasadiOps:
    """The arithmetic of expressions; see :class:`integ_gym.envs.ops.ops.Ops`."""

    epsilon = SCALAR.epsilon
    repeat = staticmethod(repeat)
    any = assume_true = assume_false = staticmethod(keep_condition)

    sin, cos = staticmethod(_unary("sin")), staticmethod(_unary("cos"))
    floor, sqrt = staticmethod(_unary("floor")), staticmethod(_unary("sqrt"))
    tanh = staticmethod(_unary("tanh"))

    def where(self, condition: Component, a: Component, b: Component, /) -> Component:
        if not isinstance(condition, Expression):
            return a if condition else b
        return Expression(casadi.if_else(condition.sx, plain(a), plain(b)))

    def minimum(self, a: Component, b: Component, /) -> Component:
        return self.where(a <= b, a, self.where(b < a, b, math.nan))

    def maximum(self, a: Component, b: Component, /) -> Component:
        return self.where(a >= b, a, self.where(b > a, b, math.nan))

    def isfinite(self, x: Component, /) -> Component:
        return abs(x) <= sys.float_info.max

    def while_loop(self, *_: Any, **__: Any) -> NoReturn:
        """Not possible: a CasADi expression has no loops whose length it finds by itself."""
        raise InputTypeError(
            "a plant with a `while_loop` cannot be expressed in CasADi; use engine 'native'"
        )

    def foreign(self, *_: Any, **__: Any) -> NoReturn:
        """Not possible: a CasADi expression is made of CasADi's own operations."""
        raise InputTypeError("a plant with a `foreign` part cannot be expressed in CasADi")
