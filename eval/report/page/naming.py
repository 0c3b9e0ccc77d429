"""Names and sentences as people read them: the truth is called so everywhere."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from integ_gym.support import load

from ...panel.model import Panel


def called(panel: Panel, name: str) -> str:
    """A row or a cell as it is shown."""
    return name if panel.truth is None else name.replace(panel.truth.name, "truth")


def said(panel: Panel, text: str) -> str:
    """A sentence as it is shown."""
    if panel.truth is not None:
        text = text.replace(panel.truth.name, "the truth")
    return text.replace("the reference", "the truth")


def naming_filters() -> dict[str, Callable[..., Any]]:
    """Filters of templates that are told of a ``panel``: names and sentences, breakable."""
    jinja2 = load("jinja2", "report")
    markup = load("markupsafe", "report")

    def breakable(text: str) -> Any:
        return markup.Markup(str(markup.escape(text)).replace("_", "_<wbr>"))

    @jinja2.pass_context
    def shown_name(context: Any, name: Any) -> Any:
        return breakable(called(context["panel"], str(name)))

    @jinja2.pass_context
    def shown_text(context: Any, text: Any) -> Any:
        return breakable(said(context["panel"], str(text)))

    @jinja2.pass_context
    def plain_text(context: Any, text: Any) -> str:
        return said(context["panel"], str(text))

    return {"called": shown_name, "said": shown_text, "said_plain": plain_text}
