"""Tables that pages quote from published files: each stands below a comment that says which.

    python docs/site/quoted.py docs/explanation/atlas.md

`<!-- ../atlas/rod_pendulum/figures/tables.md, table 2 -->` is followed by the second table of that
file, the path being the page's own.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

QUOTED = re.compile(r"(<!-- (?P<file>\S+), table (?P<number>\d+) -->\n\n)(?:\|.*\n)*\n*")


def with_quotations(page: str, folder: Path) -> str:
    """A page with its quoted tables as the files have them now.

    Args:
        folder: that the page is in.

    Raises:
        ValueError: a file has no such table.
    """

    def quotation(found: re.Match[str]) -> str:
        tables = (folder / found["file"]).read_text(encoding="utf-8").strip().split("\n\n")
        if not 1 <= int(found["number"]) <= len(tables):
            raise ValueError(f"{found['file']} has no table {found['number']}, but {len(tables)}")
        return f"{found[1]}{tables[int(found['number']) - 1]}\n\n"

    return QUOTED.sub(quotation, page)


if __name__ == "__main__":
    for path in map(Path, sys.argv[1:]):
        text = with_quotations(path.read_text(encoding="utf-8"), path.parent)
        path.write_text(text, encoding="utf-8")
