"""What a terminal shows: numbers, tables, colours, and how a command ends."""

from __future__ import annotations

import errno
import math
import os
import re
import select
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Final, TextIO

from .errors import IntegGymError

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


NONE: Final = "–"
"""Shown where the panel has no value."""

_SUPERSCRIPT: Final = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def fixed(value: float | None, digits: int = 2, sign: bool = False) -> str:
    """A number with a fixed count of decimals and a true minus sign."""
    if value is None or not math.isfinite(value):
        return NONE
    plus = "+" if sign and round(value, digits) > 0.0 else ""
    return plus + f"{value:z.{digits}f}".replace("-", "−")


def compact(value: float | None, digits: int = 2, sign: bool = False) -> str:
    """A number with a few significant digits, in powers of ten where it is large or small."""
    if value is None or not math.isfinite(value):
        return NONE
    plus = "+" if sign and value > 0.0 else ""
    value = float(f"{value:.{digits - 1}e}")
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
        return plus + f"{value:z.{decimals}f}".replace("-", "−")
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    power = str(int(exponent)).translate(_SUPERSCRIPT)
    return f"{plus}{mantissa}·10{power}".replace("-", "−")


def percent(share: float | None, digits: int = 0, sign: bool = False) -> str:
    """A share in per cent, such as ``54 %``."""
    return _in_percent(fixed(None if share is None else 100.0 * share, digits, sign))


def compact_percent(share: float | None, digits: int = 2, sign: bool = False) -> str:
    """The same with a few significant digits, such as ``3.8·10⁻⁶ %``."""
    return _in_percent(compact(None if share is None else 100.0 * share, digits, sign))


def _in_percent(text: str) -> str:
    return text if text == NONE else f"{text} %"


def together(text: str) -> str:
    """A sentence in which no line begins with the sign of a per cent."""
    return re.sub(r"(?<=\d) (?=%)", "\N{NO-BREAK SPACE}", text)


def true_minus(text: str) -> str:
    """A sentence with true minus signs before its numbers."""
    return re.sub(r"(?<=[ (])-(?=\d)", "−", text)


def seconds(value: float | None) -> str:
    """A duration in the units a person would say it in."""
    if value is None:
        return NONE
    if value < 60.0:
        return f"{value:.3g} s"
    minutes, rest = divmod(round(value), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def step(value: float | None) -> str:
    """A step size in seconds, without a unit."""
    return NONE if value is None else f"{value:.6g}"


def plural(count: int, noun: str, more: str | None = None) -> str:
    """``1 cell``, ``2 cells``."""
    return f"{count:,} {noun if count == 1 else more or noun + 's'}"


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


INTERRUPTED = 130

SHORT_OF_MEMORY = "there is not enough memory"
_FREE = "close other programs, give it fewer --workers, or raise the limit that it runs under"

DEFECT = (
    "This is a defect of integ-gym, or of code of yours that the last lines above name. Please "
    "report a defect of integ-gym with these lines, as CONTRIBUTING.md says."
)


def end_quietly(run: Callable[[], int]) -> int:
    """Run a command; one whose reader has seen enough, such as `head`, ends without a word.

    Where a standard stream is closed, as under some schedulers, what is written to it goes nowhere.
    """
    nowhere = Path(os.devnull)
    sys.stdout = sys.stdout or nowhere.open("w", encoding="utf-8")
    sys.stderr = sys.stderr or nowhere.open("w", encoding="utf-8")
    try:
        try:
            code = run()
        except SystemExit:
            sys.stdout.flush()
            raise
        sys.stdout.flush()  # what is left would else be written, and refused, at exit
        return code
    except BrokenPipeError:
        unread = [stream for stream in (sys.stdout, sys.stderr) if _has_no_reader(stream)]
        if not unread:
            raise
        for stream in unread:  # what is still to be written goes nowhere
            descriptor = os.open(os.devnull, os.O_WRONLY)
            os.dup2(descriptor, stream.fileno())
            os.close(descriptor)
        return 0


def _has_no_reader(stream: TextIO) -> bool:
    """Whether a stream is a pipe of which the other end is closed."""
    if not hasattr(select, "poll"):
        return True
    poll = select.poll()
    poll.register(stream.fileno(), 0)
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))


def report_errors(
    program: str,
    run: Callable[[], int],
    *,
    mark: str = "",
    interrupted: str = "what was finished stays",
) -> int:
    """Run a command; print what the user can mend as one line on standard error.

    That is an `IntegGymError`, what the operating system refuses, and memory that is short. Any
    other error is raised, with a last line that says that it is a defect.

    Args:
        program: the command's name, before every message.
        run: the command.
        mark: before what an error says.
        interrupted: what an interruption leaves.
    """
    try:
        with _interruptions() as noted:
            code = run()
            if noted and code != INTERRUPTED:  # and swallowed by compiled code that called back
                raise KeyboardInterrupt
            return code
    except KeyboardInterrupt:
        say(f"{program}: interrupted; {interrupted}", sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        raise
    except Exception as error:
        if is_short_of_memory(error):
            told = sentence(error) or type(error).__name__
            say(f"{program}: {mark}{SHORT_OF_MEMORY} ({told}); {_FREE}", sys.stderr)
            return 2
        if not isinstance(error, (IntegGymError, OSError)):
            error.add_note(DEFECT)
            raise
        say(f"{program}: {mark}{sentence(error)}", sys.stderr)
        return 2


@contextmanager
def _interruptions() -> Iterator[list[int]]:
    """Interruptions so far, each of which is raised as well; none outside the main thread."""
    noted: list[int] = []
    held = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(held):
        yield noted
        return

    def note(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        held(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, held)


def is_short_of_memory(error: BaseException) -> bool:
    """Whether an error says that memory could not be had: Python's, NumPy's, Arrow's or a system's.

    Arrow tells some as an error of its own kind alone, with what the C++ library said.
    """
    if isinstance(error, MemoryError):
        return True
    if isinstance(error, OSError) and error.errno == errno.ENOMEM:
        return True
    arrow = type(error).__module__.startswith("pyarrow")
    return arrow and any(word in str(error) for word in _ALLOCATING)


_ALLOCATING = ("bad_alloc", "malloc", "realloc", "Cannot allocate memory", "Out of memory")


def sentence(error: Exception) -> str:
    """What an error says, on one line; what the operating system refuses, with a remedy."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"cannot use {error.filename}: {error.strerror}; give another path"
    return " ".join(str(error).split())
