"""What all commands have in common."""

from __future__ import annotations

import argparse
import difflib
import os
import shlex
import shutil
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from ..files.writing import told_path
from ..parameters import suggestion
from .text_table import NARROWEST, fitted


def sentence(error: Exception) -> str:
    """What an error says, on one line; what the operating system refuses, with a remedy."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"cannot use {error.filename}: {error.strerror}; give another path"
    return " ".join(str(error).split())


def path_here(word: str) -> Path:
    """A path of this machine: what options mean by the ``type`` `Path`.

    Raises:
        argparse.ArgumentTypeError: for a URL.
    """
    if "://" in word:
        raise argparse.ArgumentTypeError(f"expected a path of this machine, got {word!r}")
    return Path(word)


def told_command(words: Sequence[str]) -> str:
    """A command as pages tell it, to be given again: paths as :func:`told_path` tells them."""
    return shlex.join(_told(word) for word in words)


def _told(word: str) -> str:
    name, equals, value = word.partition("=")
    if word.startswith("--") and os.path.isabs(value):
        return f"{name}{equals}{told_path(value)}"
    return told_path(word) if os.path.isabs(word) else word


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
        said = fitted(f"{self.prog}: error: {message}; see {self.prog} --help", sys.stderr)
        self.exit(2, f"{said}\n")
