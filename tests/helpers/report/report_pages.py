"""The example panels by name, and their pages taken apart."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable
from functools import cache, cached_property
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib.image
import msgspec
import pytest
import report_example as example

from integ_gym.eval.panel.result import Panel
from integ_gym.eval.report.page import render

PANELS: dict[str, Callable[[], dict[str, Any]]] = {
    "full": example.full_panel,
    "every verdict": example.every_verdict_panel,
    "given": example.given_panel,
    "nothing learned": example.nothing_learned_panel,
    "none": example.none_panel,
    "hostile": example.hostile_panel,
    "large": example.large_panel,
}
VOID = {"meta", "link", "br", "wbr", "hr", "img", "input"}


class Page(HTMLParser):
    """A page's elements; fails on tags that do not balance."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.text = ""
        self.scripts: list[str] = []
        self.packed = ""
        self._carries = False
        self._open: list[str] = []
        self.feed(html)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in VOID:
            self._open.append(tag)
        if tag == "script":
            self._carries = self.tags[-1][1].get("id") == "carried"
            if not self._carries:
                self.scripts.append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self._open
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] == "script":
            if self._carries:
                self.packed += data
            else:
                self.scripts[-1] += data
        elif not self._open or self._open[-1] != "style":
            self.text += data

    @cached_property
    def carried(self) -> tuple[dict[str, Any], bytes]:
        """JSON and numbers that the page carries."""
        data = zlib.decompress(base64.b64decode(self.packed), -zlib.MAX_WBITS)
        end = 4 + int.from_bytes(data[:4], "little")
        return json.loads(data[4:end]), data[end:]

    def values(self, name: str) -> list[str]:
        """All values of an attribute."""
        return [attributes[name] for _, attributes in self.tags if name in attributes]


def panel_from(raw: dict[str, Any]) -> Panel:
    """A panel from what ``panel.json`` would hold."""
    return msgspec.convert(raw, Panel)


@cache
def raw_of(name: str) -> dict[str, Any]:
    return PANELS[name]()


@cache
def panel_of(name: str) -> Panel:
    return panel_from(raw_of(name))


@cache
def page_of(name: str) -> Page:
    return Page(render(panel_of(name)))


every_panel = pytest.mark.parametrize("name", list(PANELS))


def pixels(path: Path) -> Any:
    """An image, shape (height, width, 3), in [0, 1]."""
    return matplotlib.image.imread(path)[..., :3]
