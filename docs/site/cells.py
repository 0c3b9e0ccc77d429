"""Cells of tables for a narrow screen: numbers that stay whole, and room for sentences."""

from __future__ import annotations

import re
from typing import Any, Final

LONG: Final = 40
"""Letters of a text that is given the room of a sentence."""

_CELL: Final = re.compile(r"<td>(.*?)</td>", re.DOTALL)
_TAG: Final = re.compile(r"(<[^>]*>)")
_GROUPS: Final = re.compile(r"(?<=\d) (?=\d{3}(?!\d))")


def on_page_content(html: str, **_: Any) -> str:
    """Mark the long cells of a page's tables, and keep the digits of a number together."""
    return _CELL.sub(lambda found: _cell(found[1]), html)


def _cell(content: str) -> str:
    parts = _TAG.split(content)
    texts = parts[::2]
    parts[::2] = [_GROUPS.sub("\N{NO-BREAK SPACE}", text) for text in texts]
    long = len(" ".join("".join(texts).split())) > LONG
    return ('<td class="long">' if long else "<td>") + "".join(parts) + "</td>"
