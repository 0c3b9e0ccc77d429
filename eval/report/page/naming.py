"""Names and sentences as people read them: the truth is called so everywhere."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from integ_gym.support import load

from ...panel.model import Panel

Filter: TypeAlias = Callable[[Any, Any], Any]
"""Of a template: from its context and a value."""


def called(panel: Panel, name: str) -> str:
    """A row or a cell as it is shown."""
    if panel.truth is None:
        return name
    return name.replace(panel.truth.name, "truth").replace("reference dt=", "truth dt=")


def said(panel: Panel, text: str) -> str:
    """A sentence as it is shown."""
    truth = panel.truth
    if truth is not None:
        text = text.replace(truth.name, "the truth")
        at = f"at dt {truth.dt:.6g} s and control period {truth.control_period:.6g} s"
        text = text.replace(f"{truth.integrator} ({truth.engine}) {at}", "the truth")
    return text.replace("the reference", "the truth")


def naming_filters() -> dict[str, Filter]:
    """Filters of templates that are told of a ``panel``: names and sentences, breakable."""
    told: Callable[[Filter], Filter] = load("jinja2", "report").pass_context
    markup = load("markupsafe", "report")

    def breakable(text: str) -> Any:
        return markup.Markup(str(markup.escape(text)).replace("_", "_<wbr>"))

    @told
    def shown_name(context: Any, name: Any) -> Any:
        return breakable(called(context["panel"], str(name)))

    @told
    def shown_text(context: Any, text: Any) -> Any:
        return breakable(said(context["panel"], str(text)))

    @told
    def plain_text(context: Any, text: Any) -> str:
        return said(context["panel"], str(text))

    return {"called": shown_name, "said": shown_text, "said_plain": plain_text}
