"""Docstrings as Markdown: Sphinx's roles become links or code, bare doctests become code blocks."""

from __future__ import annotations

import ast
import re
from typing import Any

import griffe

import integ_gym

_ROLE = re.compile(r":(?:class|func|meth|attr|data|mod):`([^`]+)`")
_MATH = re.compile(r"^\.\. math:: *(.+)$", re.MULTILINE)
_DOCTEST = re.compile(r"(?:^>>> .*\n?(?:^(?!>>> )\S.*\n?|^\.\.\..*\n?)*)+", re.MULTILINE)


class Roles(griffe.Extension):
    """Rewrites every docstring, and every field that is declared by `parameter`."""

    def on_attribute_instance(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Of ``name = parameter(default, unit, meaning, check)``: its default, and its meaning."""
        call = attr.value
        if isinstance(call, griffe.ExprCall) and str(call.function) == "parameter":
            default, unit, meaning = call.arguments[:3]
            attr.value = default
            words = [ast.literal_eval(str(part)) for part in (meaning, unit)]
            attr.docstring = griffe.Docstring(", ".join(filter(None, words)) + ".")

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite that of one class, function, module or attribute."""
        if obj.docstring is not None:
            obj.docstring.value = as_markdown(obj.docstring.value)


def as_markdown(text: str) -> str:
    """A docstring with links to the names of the users' door."""
    if "```" not in text:
        text = _DOCTEST.sub(lambda found: f"```pycon\n{found[0].rstrip()}\n```\n", text)
    text = _MATH.sub(lambda found: f"`{found[1]}`", text)
    return _ROLE.sub(lambda found: _linked(found[1]), text)


def _linked(target: str) -> str:
    name = target.lstrip("~").rpartition(".")[2]
    return f"[`{name}`][integ_gym.{name}]" if name in integ_gym.__all__ else f"`{name}`"
