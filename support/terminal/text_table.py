"""Text and tables that fit a terminal."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from typing import TextIO

from .colour import painted, shows_colours

FITS = (
    "On a terminal, tables and sentences fit its width; into a file or another program they are "
    "printed in full, unless the environment variable COLUMNS says how wide."
)
"""For the help of commands that print with this module."""

NARROWEST = 20
"""Characters in a line of the narrowest terminal that is heeded."""

READABLE = 16
"""Characters to which a column of longer texts is narrowed at most."""

Rows = Sequence[Sequence[str]]

_GAP = 2
_CUT = " ..."
_NO_BREAK = "\N{NO-BREAK SPACE}"
_BREAKS = " ,_"
"""Characters after which a line may end, the best first."""

_CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""What a terminal acts on, but for line breaks and tabs."""

_UNBROKEN = re.compile(f"[^{_BREAKS}]*[,_]?")


def width_of(file: TextIO) -> int | None:
    """Characters in a line; None, as many as it takes, where no one reads it on a terminal."""
    if os.environ.get("COLUMNS") or file.isatty():
        return max(NARROWEST, shutil.get_terminal_size().columns)
    return None


def visible(text: str) -> str:
    r"""Text in which what would move a terminal's cursor, or colour it, is shown in its place.

    >>> visible("a\x1b[2Jb")
    'a\\x1b[2Jb'
    """
    return _CONTROLS.sub(lambda found: ascii(found[0])[1:-1], text)


def unbroken(text: str) -> str:
    """Text that :func:`say` keeps on one line, such as a command to copy."""
    return text.replace(" ", _NO_BREAK)


def say(text: str, file: TextIO, indent: str = "", hanging: str = "  ") -> None:
    """Print a sentence; see :func:`fitted`."""
    print(fitted(text, file, indent, hanging), file=file)


def fitted(text: str, file: TextIO, indent: str = "", hanging: str = "  ") -> str:
    """A sentence in lines that fit.

    Args:
        text: the sentence.
        file: what is to show it.
        indent: before its first line.
        hanging: before the others, beside ``indent``.
    """
    width = width_of(file)
    room = None if width is None else width - len(indent) - len(hanging)
    first, *rest = wrapped(text, room)
    lines = indent + first, *(indent + hanging + line for line in rest)
    return "\n".join(lines).replace(_NO_BREAK, " ")


def wrapped(text: str, width: int | None) -> list[str]:
    """Lines of a text, broken at spaces; longer words after a comma, ``_``, or anywhere.

    >>> wrapped("symplectic_euler, 0.05 s", 12)
    ['symplectic_', 'euler, 0.05', 's']
    """
    text = " ".join(text.splitlines())
    if width is None:
        return [text]
    lines = [""]
    for piece in _pieces(text, width, _BREAKS):
        if lines[-1] and len(lines[-1]) + len(piece.rstrip(" ")) > width:
            lines.append("")
        lines[-1] += piece
    return [line.rstrip(" ") for line in lines]


def _pieces(text: str, width: int, breaks: str) -> Iterator[str]:
    """What of a text stays together in a line, each with the break that it ends with."""
    if len(text.rstrip(" ")) <= width:
        yield text
    elif breaks:
        for part in re.findall(f"[^{breaks[0]}]*{breaks[0]}|[^{breaks[0]}]+", text):
            yield from _pieces(part, width, breaks[1:])
    else:
        yield from (text[k : k + width] for k in range(0, len(text), width))


def print_aligned(
    names: Sequence[str],
    rows: Rows,
    file: TextIO,
    right: Sequence[bool] | None = None,
    keys: int = 0,
    colours: Mapping[str, str] | None = None,
) -> None:
    """Print cells in columns under their names.

    Where a line is too short for that, cells are broken; where that does not suffice, columns are
    printed in several tables, or if there are no keys each row as a list of names and cells.

    Args:
        names: of the columns.
        rows: the cells.
        file: where to.
        right: which columns are flush right; None: none.
        keys: how many columns at the left tell which row it is: each of several tables has them.
        colours: text of a whole cell to its colour, where the terminal has colours.
    """
    for place, columns in enumerate(_parts(names, rows, width_of(file), keys)):
        if place:
            print(file=file)
        print_groups(
            [names[i] for i in columns],
            [("", [[row[i] for i in columns] for row in rows])],
            file,
            None if right is None else [right[i] for i in columns],
            colours,
        )


def print_groups(
    names: Sequence[str],
    groups: Sequence[tuple[str, Rows]],
    file: TextIO,
    right: Sequence[bool] | None = None,
    colours: Mapping[str, str] | None = None,
) -> None:
    """Print groups of rows, each below its title, in columns under one line of names.

    Args:
        names: of the columns.
        groups: each a title, "" for none, and rows of cells.
        file: where to.
        right: which columns are flush right; None: none.
        colours: text of a whole cell to its colour, where the terminal has colours.
    """
    shown = colours if colours and shows_colours(file) else {}
    rows = [row for _, own in groups for row in own]
    widths = _fitted(names, rows, width_of(file))
    flush = right or [False] * len(names)
    if widths is not None:
        _print_row(names, widths, flush, file)
        _print_row(["-" * width for width in widths], widths, flush, file)
    for place, (title, own) in enumerate(groups):
        if title:
            print(end="\n" if place else "", file=file)
            say(title, file)
        if widths is None:
            _print_lists(names, own, file)
            continue
        for row in own:
            _print_row(row, widths, flush, file, shown)


def fits(names: Sequence[str], rows: Rows, file: TextIO) -> bool:
    """Whether columns fit a line with no cell broken."""
    width = width_of(file)
    return width is None or _total(_natural([names, *rows])) <= width


def stands_in_columns(names: Sequence[str], rows: Rows, width: int) -> bool:
    """Whether lines of a width have room for columns, with cells broken where need be."""
    return _fitted(names, rows, width) is not None


def _parts(names: Sequence[str], rows: Rows, width: int | None, keys: int) -> list[list[int]]:
    """Columns of each of the tables that a table is divided into."""
    every = list(range(len(names)))
    if not keys or _fitted(names, rows, width) is not None:
        return [every]
    needed = _unbroken_cells(names, rows)
    parts: list[list[int]] = []
    for i in every[keys:]:
        if not parts or _total([needed[j] for j in (*parts[-1], i)]) > (width or 0):
            parts.append(every[:keys])
        parts[-1].append(i)
    return parts


def _fitted(names: Sequence[str], rows: Rows, width: int | None) -> list[int] | None:
    """Widths of columns: of names and then of cells as little broken as need be; None: too many."""
    natural = _natural([names, *rows])
    if width is None or _total(natural) <= width:
        return natural
    widths = _unbroken_cells(names, rows)
    least = [
        max(_longest_word(names[i]), *(_least(row[i]) for row in rows), 0)
        for i in range(len(names))
    ]
    if _total(least) > width:
        return None
    while _total(widths) > width:
        widest = max(range(len(widths)), key=lambda i: (widths[i] > least[i], widths[i], i))
        widths[widest] -= 1
    for i, wanted in enumerate(natural):
        widths[i] += min(wanted - widths[i], width - _total(widths))
    return widths


def _natural(rows: Rows) -> list[int]:
    return [max(map(len, column)) for column in zip(*rows, strict=True)]


def _unbroken_cells(names: Sequence[str], rows: Rows) -> list[int]:
    """Widths of columns whose names alone are broken."""
    return _natural([[" " * _longest_word(name) for name in names], *rows])


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + _GAP * (len(widths) - 1)


def _longest_word(text: str) -> int:
    return max(map(len, text.split(" ")))


def _least(cell: str) -> int:
    """The width below which a cell would be hard to read."""
    return max(min(len(cell), READABLE), *map(len, _UNBROKEN.findall(cell)))


def _print_row(
    cells: Sequence[str],
    widths: Sequence[int],
    flush: Sequence[bool],
    file: TextIO,
    colours: Mapping[str, str] | None = None,
) -> None:
    broken = [wrapped(cell, width) for cell, width in zip(cells, widths, strict=True)]
    for k in range(max(map(len, broken))):
        line = [lines[k] if k < len(lines) else "" for lines in broken]
        padded = (
            text.rjust(width) if right else text.ljust(width)
            for text, width, right in zip(line, widths, flush, strict=True)
        )
        shown = [
            painted(text, colours[cell]) if colours and cell in colours else text
            for text, cell in zip(padded, cells, strict=True)
        ]
        print((" " * _GAP).join(shown).rstrip(), file=file)


def _print_lists(names: Sequence[str], rows: Rows, file: TextIO) -> None:
    """Each row as lines of a name and a cell."""
    before, width = max(map(len, names)) + _GAP, width_of(file)
    for place, row in enumerate(rows):
        print(end="\n" if place else "", file=file)
        for name, cell in zip(names, row, strict=True):
            print(beside(f"{name:<{before}}", cell, width), file=file)


def beside(name: str, text: str, width: int | None, most: int | None = None) -> str:
    """A text to the right of its name, each of its lines below the first.

    Args:
        name: of the text.
        text: what is shown.
        width: characters in a line; None: as many as it takes.
        most: lines; where there are more, the last of these ends with three dots.
    """
    room = None if width is None else max(NARROWEST // 2, width - len(name))
    lines = wrapped(text, room)
    if room is not None and most is not None and len(lines) > most:
        lines = [*lines[: most - 1], lines[most - 1][: room - len(_CUT)].rstrip() + _CUT]
    return (name + f"\n{' ' * len(name)}".join(lines)).rstrip()
