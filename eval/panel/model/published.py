"""The published JSON Schema of ``panel.json``, generated from the model and its docstrings.

After a change of the model, :func:`write_schema` brings the published file up to date.
"""

from __future__ import annotations

import inspect
import json
import re
from pathlib import Path
from typing import Any

import msgspec

from .panel import SCHEMA_VERSION, Panel

SCHEMA_PATH = Path(__file__).with_name("panel.schema.json")


def json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of ``panel.json``; every property is described with its unit."""
    (whole,), parts = msgspec.json.schema_components([Panel], ref_template="#/$defs/{name}")
    for part in parts.values():
        _describe(part)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"integ-gym panel, version {SCHEMA_VERSION}",
        **whole,
        "$defs": parts,
    }


def _describe(part: dict[str, Any]) -> None:
    """Give the attributes that a docstring lists to the properties; a file holds all of them."""
    about, _, rest = inspect.cleandoc(part["description"]).partition("\n\nAttributes:\n")
    attributes = inspect.cleandoc(rest.partition("\n\n")[0])
    found = re.findall(r"^(\w+): (.*(?:\n .*)*)", attributes, re.MULTILINE)
    meanings = {name: " ".join(text.split()) for name, text in found}
    meanings |= {"return": meanings.get("returns", "")}
    part["description"] = " ".join(about.split())
    part["required"] = list(part["properties"])
    for name, kind in part["properties"].items():
        kind.pop("default", None)
        kind["description"] = meanings[name]


def schema_text() -> str:
    """The content of the published file."""
    return json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"


def write_schema() -> None:
    """Write the published file."""
    SCHEMA_PATH.write_text(schema_text(), encoding="utf-8")
