"""What all commands have in common."""

from __future__ import annotations

import argparse
import json
from typing import Any, NoReturn


def sentence(error: Exception) -> str:
    """What an error says, on one line; what the operating system refuses, with a remedy."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"cannot use {error.filename}: {error.strerror}; give another path"
    return " ".join(str(error).split())


def named_value(word: str) -> tuple[str, Any]:
    """``name=value``, the value read as JSON where it is JSON, else as text."""
    name, equals, value = word.partition("=")
    if not equals or not name:
        raise argparse.ArgumentTypeError(f"expected NAME=VALUE, got {word!r}")
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value


class CommandParser(argparse.ArgumentParser):
    """Shows its epilog as it stands, and says in one line what is wrong."""

    def __init__(self, **arguments: Any) -> None:
        arguments.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        arguments.setdefault("allow_abbrev", False)
        super().__init__(**arguments)

    def error(self, message: str) -> NoReturn:
        """Exit with code 2 and one line on standard error."""
        self.exit(2, f"{self.prog}: error: {message}; see {self.prog} --help\n")
