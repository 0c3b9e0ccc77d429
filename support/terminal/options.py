"""Types of options: what argparse makes of a word, and says of a wrong one."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..storage import named_place


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


def by_name(
    pairs: Iterable[tuple[str, Any]], flag: str, options: Mapping[str, str]
) -> dict[str, Any]:
    """Values given by name, of which none has an option of its own.

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
            raise ValueError(f"{flag} says both {name}={values[name]} and {value}; give one")
    for name in values:
        if name in options:
            raise ValueError(f"give {options[name]} in place of {flag} {name}")
    return values


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
            raise ValueError(f"{why}, so {flag} says nothing; leave it out")


def whole_number(word: str) -> int:
    """A whole number, also as ``1e5``: a ``type`` of options.

    >>> whole_number("1e5"), whole_number("-3")
    (100000, -3)

    Raises:
        argparse.ArgumentTypeError: for anything else.
    """
    try:
        return int(word)
    except ValueError:
        number = _float(word)
    if not number.is_integer():
        raise argparse.ArgumentTypeError(
            f"expected a whole number, such as 100000 or 1e5, got {word!r}"
        )
    return int(number)


def run_place(word: str) -> str | Path:
    """A folder, or the URL of a place in an object store: a ``type`` of options.

    Raises:
        argparse.ArgumentTypeError: for another URL.
    """
    try:
        return named_place(word)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _float(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan
