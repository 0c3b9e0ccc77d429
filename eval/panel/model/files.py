"""``panel.json`` written and read."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import msgspec

from integ_gym.support.errors import InputError
from integ_gym.support.files import read_bounded, write_json

from .panel import SCHEMA_VERSION, Panel

FILE_NAME: Final = "panel.json"
"""Name of the file in a panel's directory."""

LARGEST = 256 << 20
"""Bytes of it, at most."""


class _Version(msgspec.Struct):
    schema_version: Any = None


def write_panel(panel: Panel, directory: Path) -> Path:
    """Write ``panel.json`` into a panel's directory, whole or not at all.

    Raises:
        ValueError: if a number is not finite.
    """
    path = directory / FILE_NAME
    write_json(path, msgspec.to_builtins(panel))
    return path


def read_panel(path: Path) -> Panel:
    """Read a ``panel.json``.

    Raises:
        ValueError: in one sentence with the remedy, if the file is not JSON, is of another schema
            version, lacks something or contradicts itself.
    """
    try:
        content = read_bounded(path, LARGEST)
        version = msgspec.json.decode(content, type=_Version).schema_version
        if version == SCHEMA_VERSION:
            return msgspec.json.decode(content, type=Panel)
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise InputError(
            f"{path} is damaged or holds no panel ({error}); run the panel again to write it anew"
        ) from error
    raise InputError(
        f"{path} has panel schema_version {version!r}, expected {SCHEMA_VERSION}; run the panel's "
        "command again, which keeps what is finished and writes the file anew, or use the "
        "integ-gym version that wrote it"
    )
