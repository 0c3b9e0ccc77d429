"""What every page is made with: one file that opens offline and loads nothing.

The content security policy forbids that a page ever loads anything; the only script is named there
by its hash, so that no text of a result can become one.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

from .figures import AMOUNTS, HUES, PALETTE, channels
from .optional import load
from .terminal import compact, fixed, nonbreaking, percent, seconds, step


@cache
def page_template(package: str, name: str) -> Any:
    """The template of a page, from a file beside a package's modules; see below."""
    text = resources.files(package).joinpath(name).read_text("utf-8")
    return page_environment().from_string(text)


def page_environment(templates: Mapping[str, str] | None = None) -> Any:
    """A jinja2 environment that escapes everything, with the filters of numbers.

    Its templates may extend ``page.html.j2``, the frame of a page.

    Args:
        templates: that others may include, by name.

    Raises:
        ModuleNotFoundError: if jinja2 is not installed, with the command that installs it.
    """
    jinja2 = load("jinja2", "report")
    frame = resources.files(__package__).joinpath("page.html.j2").read_text("utf-8")
    environment = jinja2.Environment(
        loader=jinja2.DictLoader({"page.html.j2": frame, **(templates or {})}),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        nonbreaking=nonbreaking,
        soft=_soft,
        fixed=fixed,
        compact=compact,
        percent=_percent,
        seconds=seconds,
        step=step,
    )
    return environment


@cache
def page_parts(style: str = "", script: str = "") -> dict[str, Any]:
    """`style`, `script` and `script_hash`, as templates name them.

    The script of all pages opens what a link leads to and, for print, all that is closed, and sets
    a button beside every command.

    Args:
        style: rules of one page, after those that all have.
        script: statements of one page, after those that all have.
    """
    markup = load("markupsafe", "report").Markup
    files = resources.files(__package__)
    sheet, own = (files.joinpath(f"page.{kind}").read_text("utf-8") for kind in ("css", "js"))
    whole = f"\n{own}{script}"
    digest = base64.b64encode(hashlib.sha256(whole.encode()).digest()).decode()
    return {
        "style": markup(f"{_colours()}\n{sheet}{style}"),
        "script": markup(whole),
        "script_hash": f"sha256-{digest}",
    }


_AS_CHANNELS = ("warm", "cool")
"""Colours that pages thin out."""


def _colours() -> str:
    """The colours of both schemes as properties, with classes for hues and amounts of energy."""
    grounds = []
    for ground in (0, 1):
        found = {name: pair[ground] for name, pair in PALETTE.items()}
        found |= {f"h-{name}": pair[ground] for name, pair in HUES.items()}
        found |= {name: " ".join(map(str, channels(found[name]))) for name in _AS_CHANNELS}
        grounds.append(" ".join(f"--{name}: {value};" for name, value in found.items()))
    light, dark = grounds
    classes = " ".join(f".h-{name} {{ --c: var(--h-{name}); }}" for name in HUES)
    bars = " ".join(
        f"i.{name}{side} {{ background: {_css_colour(colour)}; }}"
        for name, pair in AMOUNTS.items()
        for side, colour in zip(("", ".below"), pair, strict=True)
    )
    return (
        f":root {{ {light} --shadow: 0 1px 2px rgb(20 23 28 / .05), 0 6px 20px "
        "rgb(20 23 28 / .05); }\n"
        f"@media (prefers-color-scheme: dark) {{ :root {{ {dark} --shadow: none; }} }}\n"
        f"{classes}\n{bars}"
    )


def _css_colour(name: str) -> str:
    """A colour of the palette, as a style names it."""
    return f"rgb(var(--{name}))" if name in _AS_CHANNELS else f"var(--{name})"


def _percent(share: float | None) -> str:
    return nonbreaking(percent(share))


def _soft(text: Any) -> Any:
    """Allow line breaks after underscores."""
    markup = load("markupsafe", "report")
    return markup.Markup(str(markup.escape(text)).replace("_", "_<wbr>"))
