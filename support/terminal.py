"""What a terminal shows: numbers, sentences, tables, bars, and how a command ends."""

from __future__ import annotations

import errno
import math
import os
import re
import select
import shutil
import signal
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Final, Self, TextIO

from .errors import IntegGymError
from .optional import load

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


def nonbreaking(text: str) -> str:
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


def list_some(names: Sequence[str], most: int) -> str:
    """Names in a sentence, cut where it gets too long to read."""
    if len(names) > most:
        return f"{', '.join(names[:most])} and {len(names) - most} more"
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


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
_CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""What a terminal acts on, but for line breaks and tabs."""


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


def keep_on_one_line(text: str) -> str:
    """Text that :func:`print_wrapped` keeps on one line, such as a command to copy."""
    return text.replace(" ", _NO_BREAK)


def print_wrapped(
    text: str, file: TextIO | None = None, indent: str = "", hanging: str = "  "
) -> None:
    """Print a sentence, by default on standard output; see :func:`wrap`."""
    file = file or sys.stdout
    print(wrap(text, file, indent, hanging), file=file)


def print_command(command: str) -> None:
    """Print a command to copy; one of a shell goes on after a backslash where a line is too short.

    Quoted words, and options with their values, stay on one line.
    """
    width, lines = width_of(sys.stdout), [command]
    words = re.findall(r"(?:--[\w-]+ (?!-))?(?:'[^']*'|[^\s'])+", command)
    if width is not None and command.startswith("integ-gym ") and " ".join(words) == command:
        text = " ".join(map(keep_on_one_line, words))
        room = max(NARROWEST, width - 8)
        lines = textwrap.wrap(text, room, break_long_words=False, break_on_hyphens=False)
    print("  " + " \\\n      ".join(lines).replace(_NO_BREAK, " "))


def wrap(text: str, file: TextIO, indent: str = "", hanging: str = "  ") -> str:
    """A sentence in lines that fit.

    Args:
        text: the sentence.
        file: what is to show it.
        indent: before its first line.
        hanging: before the others, beside ``indent``.
    """
    width, text = width_of(file), " ".join(text.splitlines())
    if width is not None:
        text = textwrap.fill(
            text,
            width,
            initial_indent=indent,
            subsequent_indent=indent + hanging,
            break_on_hyphens=False,
        )
    else:
        text = indent + text
    return text.replace(_NO_BREAK, " ")


def hanging_indent(name: str, text: str, width: int | None, most: int | None = None) -> str:
    """A text to the right of its name, each of its lines below the first.

    Args:
        name: of the text.
        text: what is shown.
        width: characters in a line; None: as many as it takes.
        most: lines; where there are more, the last of these ends with three dots.
    """
    text = " ".join(text.splitlines())
    if width is not None:
        room = max(NARROWEST // 2, width - len(name))
        lines = textwrap.wrap(text, room, break_on_hyphens=False, max_lines=most, placeholder=_CUT)
        text = f"\n{' ' * len(name)}".join(lines)
    return (name + text).rstrip()


def column_widths(names: Sequence[str], rows: Rows, width: int) -> list[int] | None:
    """Widths that fit, names broken before cells and long words last; None if there are none."""
    words = [max(map(len, name.split(" "))) for name in names]
    cells = list(zip(*rows, strict=True)) or [()] * len(names)
    room = width - _GAP * (len(names) - 1)
    for least_width in (_least_width, _least_folded):
        least = [
            max([word, *map(least_width, own)]) for word, own in zip(words, cells, strict=True)
        ]
        if sum(least) <= room:
            break
    else:
        return None
    widths = [max([word, *map(len, own)]) for word, own in zip(words, cells, strict=True)]
    while sum(widths) > room:
        widths[max(range(len(widths)), key=lambda i: (widths[i] > least[i], widths[i]))] -= 1
    for i, name in enumerate(names):
        widths[i] += max(0, min(len(name) - widths[i], room - sum(widths)))
    return widths


def _least_width(cell: str) -> int:
    """Characters below which a cell would be hard to read."""
    return max(min(len(cell), READABLE), *map(len, cell.split(" ")), 0)


def _least_folded(cell: str) -> int:
    """The same where long words may be broken after a sign."""
    return min(len(cell), READABLE)


def _fold_cell(cell: str, width: int) -> str:
    """A cell whose words fit, those that are longer broken after a sign where they have one."""
    words = []
    for word in cell.split(" "):
        while len(word) > width:
            end = max([word.rfind(sign, 0, width) for sign in "_-./=,"]) + 1 or width
            words.append(word[:end] + "\n")
            word = word[end:]
        words.append(word + " ")
    return "".join(words)[:-1]


def print_columns(
    names: Sequence[str],
    rows: Rows,
    file: TextIO | None = None,
    right: Sequence[bool] | None = None,
    colours: Mapping[str, str] | None = None,
    optional: Sequence[str] = (),
) -> None:
    """Print cells in columns under their names.

    Where a line is too short for that, cells are broken, then optional columns left out; where that
    does not suffice, each row is printed as a list of names and cells.

    Args:
        names: of the columns.
        rows: the cells.
        file: where to; by default standard output.
        right: which columns are flush right; None: none.
        colours: text of a whole cell to its style of rich, where the terminal has colours.
        optional: names of columns that may be left out, the last one first.
    """
    file = file or sys.stdout
    width = width_of(file)
    left_out: list[str] = []
    while (widths := column_widths(names, rows, width or 1 << 20)) is None and optional:
        *optional, name = optional
        place = list(names).index(name)
        left_out.append(name)
        names, *rows = ([*row[:place], *row[place + 1 :]] for row in (names, *rows))
        right = right and [*right[:place], *right[place + 1 :]]
    if widths is None:
        print_lists(names, rows, file, width)
        return
    console_of, table_of, text_of = (
        getattr(load(f"rich.{module}", "evidence"), name)
        for module, name in (("console", "Console"), ("table", "Table"), ("text", "Text"))
    )
    box = load("rich.box", "evidence").Box("    \n    \n -  \n    \n    \n    \n    \n    \n")
    table = table_of(
        box=box, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0), header_style=""
    )
    for place, name in enumerate(names):
        justify = "right" if right and right[place] else "left"
        table.add_column(text_of(name), justify=justify, overflow="fold", width=widths[place])
    for row in rows:
        cells = zip(row, widths, strict=True)
        table.add_row(
            *(text_of(_fold_cell(x, most), style=(colours or {}).get(x, "")) for x, most in cells)
        )
    plain = {"color_system": None} if os.environ.get("NO_COLOR") else {}
    console = console_of(file=file, width=width or 1 << 20, **plain)
    with console.capture() as captured:
        console.print(table)
    for line in captured.get().splitlines():
        ruled = not line.strip("- ") and "-" in line
        print((line.replace("- -", "  -") if ruled else line).rstrip(), file=file)
    if left_out:
        print_wrapped(
            f"Left out to fit {width} characters: {', '.join(reversed(left_out))}. A wider "
            "terminal, a file or `| less -S` has all columns.",
            file,
        )


def print_lists(
    names: Sequence[str], rows: Rows, file: TextIO, width: int | None, most: int | None = None
) -> bool:
    """Print each row as lines of a name and a cell; whether cells were cut to ``most`` lines."""
    before, cut = max(map(len, names)) + _GAP, False
    for place, row in enumerate(rows):
        print(end="\n" if place else "", file=file)
        for name, cell in zip(names, row, strict=True):
            whole, shown = (
                hanging_indent(f"{name:<{before}}", cell, width, n) for n in (None, most)
            )
            cut = cut or shown != whole
            print(shown, file=file)
    return cut


MOST_BEFORE_END: Final = 0.99
"""Share of a bar that is full while work goes on, however far the estimate was off."""

LEAST_TOLD: Final = 0.01
"""Share of the work that must have been done until it is said how long the rest takes."""

_DRAW_SECONDS, _LOG_SECONDS = 0.5, 15.0
"""Least time between two pictures of a bar on a terminal, and in a file, s."""


_LEAST_BAR: Final = 6
"""Least columns of a bar beside its words."""


class WorkBar:
    """A bar on standard error for work that takes long; it starts no thread.

    It is full once its ``with`` block ends without an error, or `fill` is called, and says "nearly
    done" when the work takes longer than expected.

    Args:
        label: of the bar.
        total: expected work.
        shown: whether it is.
        unit: of what is counted; empty where ``total`` is an estimate in seconds.

    Attributes:
        n: work that was done.
    """

    def __init__(self, label: str, total: float, shown: bool, unit: str = "") -> None:
        self.label, self.total, self.unit = label, total, unit
        self.n = self._begun = 0.0
        self._filled, self._phase, self._drawn = False, "", -math.inf
        self._progress: Any = None
        if shown:
            rich = load("rich.progress", "evidence")
            console = load("rich.console", "evidence").Console(file=sys.stderr)
            self._terminal = console.is_terminal and not console.is_dumb_terminal
            self._width = console.width if self._terminal else math.inf
            columns = ("{task.description}", rich.BarColumn(24), "{task.fields[words]}")
            self._progress = rich.Progress(
                *columns,
                console=console,
                auto_refresh=False,
                redirect_stdout=False,  # which may go somewhere else
                disable=not self._terminal,
            )
            self._task = self._progress.add_task(label, total=total or 1.0, words="")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.fill()
        self.close()

    def update(self, amount: float = 1.0) -> None:
        """Count work that was done; the clock moves also without any."""
        self.n += amount
        if self._progress is not None:
            self._progress.update(self._task, completed=self._shown)
            self._draw()

    def describe(self, phase: str, draw: bool = True) -> None:
        """Say what is done now, or how it goes.

        Args:
            phase: in words.
            draw: at once, if it has changed; else when the bar moves next.
        """
        changed, self._phase = phase != self._phase, phase
        if self._progress is not None and changed and draw:
            self._draw(at_once=True)

    def begin_at(self, amount: float) -> None:
        """Begin with work that was done before, which says nothing of how long the rest takes."""
        self.n = self._begun = amount
        if self._progress is not None:
            self._progress.reset(self._task, completed=self._shown)

    def fill(self) -> None:
        """Show that the work is done."""
        self.n, self._filled = self.total, True
        if self._progress is not None:
            self._progress.update(self._task, completed=self.n)
            self._draw(at_once=True)

    def close(self) -> None:
        """Leave the bar as it is."""
        if self._progress is not None:
            self._draw(at_once=not self._filled)
            self._progress.stop()
            self._progress = None

    @property
    def _shown(self) -> float:
        return self.n if self._filled else min(self.n, MOST_BEFORE_END * self.total)

    def _words(self) -> str:
        """Share or count, time, what is left of it, and the phase."""
        task = self._progress.tasks[0]
        parts = [f"{self._shown / (self.total or 1.0):.0%}"]
        if self.unit:
            parts.append(f"{self._shown:,.0f} of {self.total:,.0f}{self.unit}")
        elapsed, done = task.elapsed or 0.0, self.n - self._begun
        taken = seconds(round(elapsed))
        parts.append(taken if self._filled else f"{taken} so far")
        if not self._filled and self.n > MOST_BEFORE_END * self.total:
            parts.append("nearly done")
        elif not self._filled and done > LEAST_TOLD * self.total:
            # by all that was done: units that end together say nothing of the pace
            parts.append(f"about {seconds(round(elapsed * (self.total - self.n) / done))} left")
        if self._phase:
            parts.append(self._phase)
        if self.unit and len(", ".join((self.label, *parts))) > self._width - _LEAST_BAR:
            del parts[1]  # the count, which the share says too
        return ", ".join(parts)

    def _draw(self, at_once: bool = False) -> None:
        now = time.monotonic()
        if not at_once and now - self._drawn < (_DRAW_SECONDS if self._terminal else _LOG_SECONDS):
            return
        self._drawn = now
        if self._terminal:
            self._progress.start()  # nothing, once it is
            self._progress.update(self._task, words=self._words())
            self._progress.refresh()
        else:
            print(f"{self.label}: {self._words()}", file=sys.stderr, flush=True)


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
        print_wrapped(f"{program}: interrupted; {interrupted}", sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        raise
    except Exception as error:
        if is_short_of_memory(error):
            words = format_exception(error) or type(error).__name__
            print_wrapped(f"{program}: {mark}{SHORT_OF_MEMORY} ({words}); {_FREE}", sys.stderr)
            return 2
        if not isinstance(error, (IntegGymError, OSError)):
            error.add_note(DEFECT)
            raise
        print_wrapped(f"{program}: {mark}{format_exception(error)}", sys.stderr)
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


def format_exception(error: Exception) -> str:
    """What an error says, on one line; what the operating system refuses, with a remedy."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"cannot use {error.filename}: {error.strerror}; give another path"
    return " ".join(str(error).split())
