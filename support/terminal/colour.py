"""Colours on a terminal that shows them."""

from __future__ import annotations

import os
from typing import Final, TextIO

RED: Final = "31"
GREEN: Final = "32"
YELLOW: Final = "33"
DIM: Final = "2"


def shows_colours(file: TextIO) -> bool:
    """Whether a stream is a terminal with colours, and nobody has asked for none.

    ``NO_COLOR`` asks for none, whatever its value, see https://no-color.org.
    """
    return file.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def painted(text: str, colour: str) -> str:
    """A text in a colour; spaces around it stay as they are."""
    inner = text.strip()
    return text.replace(inner, f"\x1b[{colour}m{inner}\x1b[0m", 1) if inner else text
