"""Filters of templates for names and sentences: the truth is called so, and long names break."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from integ_gym.support.optional import load
from integ_gym.support.terminal import together

Filter: TypeAlias = Callable[[Any, Any], Any]
"""Of a template: from its context and a value."""


def naming_filters() -> dict[str, Filter]:
    """Filters of templates that are told of a ``panel``: names and sentences, breakable."""
    told: Callable[[Filter], Filter] = load("jinja2", "report").pass_context
    markup = load("markupsafe", "report")

    def breakable(text: str) -> Any:
        return markup.Markup(str(markup.escape(text)).replace("_", "_<wbr>"))

    @told
    def shown_name(context: Any, name: Any) -> Any:
        return breakable(context["panel"].called(str(name)))

    @told
    def shown_text(context: Any, text: Any) -> Any:
        return breakable(together(context["panel"].said(str(text))))

    @told
    def plain_text(context: Any, text: Any) -> Any:
        return context["panel"].said(str(text))

    return {"called": shown_name, "said": shown_text, "said_plain": plain_text}
