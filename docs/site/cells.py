"""Tables and code for a narrow screen: whole numbers, room for sentences, lines that wrap."""

from __future__ import annotations

import re
from typing import Any, Final

LONG: Final = 40
"""Letters of a text that is given the room of a sentence."""

LONG_CODE: Final = 24
"""Letters of code that may be broken after the marks between its words."""

_NUMBER: Final = re.compile(r"[+−-]?\d.{,14}")  # with what little is beside it, as a unit
_CELL: Final = re.compile(r"<td>(.*?)</td>", re.DOTALL)
_TAG: Final = re.compile(r"(<[^>]*>)")
_CODE: Final = re.compile(rf"<code>([^<]{{{LONG_CODE + 1},}})</code>")
_MARK: Final = re.compile(r"(?<=[_./=,])(?=\w)")
_BLOCK: Final = re.compile(
    r'<div class="(?:language-(\w+) )?highlight">(.*?</code></pre>)</div>', re.DOTALL
)
_ALIGNED: Final = re.compile(r"\S {2,}\S")
_GROUPS: Final = re.compile(r"(?<=\d) (?=\d{3}(?!\d))")


def on_page_content(html: str, **_: Any) -> str:
    """Mark long cells of tables, keep digits of a number together, and mark code that wraps."""
    return _BLOCK.sub(_block, _CELL.sub(lambda found: _cell(found[1]), html))


def _block(found: re.Match[str]) -> str:
    """Commands and sentences wrap; programs and columns scroll."""
    language = found[1] or "text"
    text = _TAG.sub("", found[2])
    prose = language == "text" and not _ALIGNED.search(text)
    wraps = " wrapped" if prose or language in ("sh", "bash") else ""
    return f'<div class="language-{language} highlight{wraps}">{found[2]}</div>'


def _cell(content: str) -> str:
    parts = _TAG.split(content)
    kind = _kind(" ".join("".join(parts[::2]).split()))
    parts[::2] = [_GROUPS.sub("\N{NO-BREAK SPACE}", text) for text in parts[::2]]
    inner_html = _CODE.sub(lambda found: _code(found[1]), "".join(parts))
    return (f'<td class="{kind}">' if kind else "<td>") + inner_html + "</td>"


def _kind(text: str) -> str:
    """The class of a cell."""
    if len(text) > LONG:
        return "long"
    return "number" if _NUMBER.fullmatch(text) else ""


def _code(text: str) -> str:
    return f'<code class="long">{_MARK.sub("<wbr>", text)}</code>'
