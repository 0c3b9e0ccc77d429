"""The readable half of the JSON in the member `data`."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any, TypeAlias

from ...error import DAMAGED, PolicyFileError

Json: TypeAlias = Mapping[str, Any]

_CLASS_TEXT = re.compile(r"<class '([\w.]+)'>")


def json_object(content: bytes, sentence: str) -> Json:
    """A JSON object, whose numbers may be infinite as those of models are.

    Raises:
        PolicyFileError: on anything else, with `sentence`, completed by the defect.
    """
    try:
        parsed = json.loads(content.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise PolicyFileError(sentence.format("is not readable JSON")) from error
    if not isinstance(parsed, dict):
        raise PolicyFileError(sentence.format("is not a JSON object"))
    return parsed


def section(data: Json, name: str) -> Json:
    """A member of `data` that must be an object."""
    found = data.get(name)
    if not isinstance(found, dict):
        raise PolicyFileError(f"its 'data' has no readable '{name}'; {DAMAGED}")
    return found


def printed_class(text: str) -> str:
    """The dotted name of a class that was printed as ``<class '…'>``; empty for another text."""
    found = _CLASS_TEXT.fullmatch(text)
    return found.group(1) if found else ""
