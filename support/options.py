"""Command lines: parsers, and options that several commands share."""

from __future__ import annotations

import argparse
import difflib
import json
import os
import shlex
import shutil
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from .errors import InputError
from .files import display_path
from .parameters import suggestion
from .storage import resolve_place
from .terminal import NARROWEST, wrap


def path_here(word: str) -> Path:
    """A path of this machine: what options mean by the ``type`` `Path`.

    Raises:
        argparse.ArgumentTypeError: for a URL.
    """
    if "://" in word:
        raise argparse.ArgumentTypeError(f"expected a path of this machine, got {word!r}")
    return Path(word)


def file_or_hub(word: str) -> str | Path:
    """A path of this machine, or a file of the Hugging Face Hub: a ``type`` of options.

    Raises:
        argparse.ArgumentTypeError: for another URL.
    """
    return word if word.startswith("hf://") else path_here(word)


def display_command(words: Sequence[str]) -> str:
    """A command as pages show it, to be given again: paths as :func:`display_path` shows them."""
    return shlex.join(_display_word(word) for word in words)


def _display_word(word: str) -> str:
    name, equals, value = word.partition("=")
    if word.startswith("--") and os.path.isabs(value):
        return f"{name}{equals}{display_path(value)}"
    return display_path(word) if os.path.isabs(word) else word


class CommandParser(argparse.ArgumentParser):
    """Shows its epilog as it stands, and says in one line what is wrong."""

    def __init__(self, description: str | None = None, **arguments: Any) -> None:
        arguments.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        arguments.setdefault("allow_abbrev", False)
        if description is not None:  # which argparse leaves as it stands too
            width = max(NARROWEST, shutil.get_terminal_size().columns - 2)
            description = textwrap.fill(description, width)
        super().__init__(description=description, **arguments)
        self.register("type", Path, path_here)

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As `argparse`'s; an option that is unknown is named with the one that is meant."""
        given, unknown = self.parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}{self._near(unknown)}")
        return given

    def _near(self, unknown: Sequence[str]) -> str:
        name = next((word.partition("=")[0] for word in unknown if word.startswith("--")), "")
        near = difflib.get_close_matches(name, self._option_string_actions, n=1)
        return f"; did you mean {near[0]}?" if near else ""

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            meant = suggestion(str(value), map(str, action.choices))
            raise argparse.ArgumentError(action, f"there is no {value!r}. {meant}")

    def error(self, message: str) -> NoReturn:
        """Exit with code 2 and one sentence on standard error."""
        said = wrap(f"{self.prog}: error: {message}; see {self.prog} --help", sys.stderr)
        self.exit(2, f"{said}\n")


def named_value(word: str) -> tuple[str, Any]:
    """``name=value``, the value read as JSON where it is JSON, else as text."""
    name, equals, value = word.partition("=")
    if not equals or not name:
        raise argparse.ArgumentTypeError(f"expected NAME=VALUE, got {word!r}")
    try:
        return name, json.loads(value)
    except (ValueError, RecursionError):
        return name, value


def add_named_values(parser: Any, flag: str, described: str) -> None:
    """An option that takes ``NAME=VALUE``, as often as it is given; see :func:`by_name`.

    Args:
        parser: or a group of one.
        flag: as ``--env-arg``.
        described: what is named, for the help.
    """
    parser.add_argument(
        flag,
        action="append",
        default=[],
        type=named_value,
        metavar="NAME=VALUE",
        help=f"{described}; may be repeated",
    )


def listed_values(word: str) -> tuple[str, list[Any]]:
    """``name=value,value``, values read as JSON where all are JSON, else as text.

    >>> listed_values("control_period=0.02,0.04"), listed_values("fallback=hold,zero")
    (('control_period', [0.02, 0.04]), ('fallback', ['hold', 'zero']))

    Raises:
        argparse.ArgumentTypeError: for anything else.
    """
    name, _ = named_value(word)
    values = word.partition("=")[2]
    try:
        return name, list(json.loads(f"[{values}]"))
    except (ValueError, RecursionError):
        return name, values.split(",")


def nest(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values whose names have dots as tables.

    >>> nest({"dt": 0.1, "solver.iterations": [1, 100]})
    {'dt': 0.1, 'solver': {'iterations': [1, 100]}}

    Raises:
        ValueError: where something is both a value and a table.
    """
    found: dict[str, Any] = {}
    for path, value in values.items():
        *tables, name = path.split(".")
        place = found
        for table in tables:
            place = place.setdefault(table, {})
            if not isinstance(place, dict):
                break
        if not isinstance(place, dict) or isinstance(place.get(name), dict):
            raise InputError(f"{path!r} is part of a value that is given too; give one of them")
        place[name] = value
    return found


def by_name(
    pairs: Iterable[tuple[str, Any]], flag: str, options: Mapping[str, str]
) -> dict[str, Any]:
    """Values given by name, of which none has an option of its own; names with dots are tables.

    Args:
        pairs: of :func:`add_named_values`.
        flag: the option by which they were given.
        options: of names that are given by themselves, as ``--dt`` of ``dt``.

    Raises:
        ValueError: naming the first for which there is another option, or two values.
    """
    values: dict[str, Any] = {}
    for name, value in pairs:
        if values.setdefault(name, value) != value:
            raise InputError(f"{flag} says both {name}={values[name]} and {value}; give one")
    for name in values:
        if name in options:
            raise InputError(f"give {options[name]} in place of {flag} {name}")
    return nest(values)


def refuse_unused(
    parser: argparse.ArgumentParser, given: argparse.Namespace, why: str, used: Iterable[str]
) -> None:
    """Refuse the options that a way of calling a command does not use.

    Args:
        parser: of the command.
        given: its arguments.
        why: the way, as the beginning of a sentence, such as "--plan runs nothing".
        used: names of the arguments that it uses.

    Raises:
        ValueError: naming the first other one that was given.
    """
    known = {*used, "help"}
    for action in parser._actions:
        if action.dest not in known and getattr(given, action.dest) != action.default:
            flag = next(iter(action.option_strings), action.metavar or action.dest)
            raise InputError(f"{why}, so {flag} has no effect; leave it out")


def whole_number(word: str) -> int:
    """A whole number, also as ``1e5``: a ``type`` of options.

    >>> whole_number("1e5"), whole_number("-3")
    (100000, -3)

    Raises:
        argparse.ArgumentTypeError: for anything else.
    """
    with suppress(ValueError):
        return int(word)
    with suppress(ValueError):
        if (number := float(word)).is_integer():
            return int(number)
    raise argparse.ArgumentTypeError(
        f"expected a whole number, such as 100000 or 1e5, got {word!r}"
    )


def run_place(word: str) -> str | Path:
    """A folder, or the URL of a place in an object store: a ``type`` of options.

    Raises:
        argparse.ArgumentTypeError: for another URL.
    """
    try:
        return resolve_place(word)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
