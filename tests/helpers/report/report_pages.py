"""The example panels by name, their pages taken apart, and made-up episodes of theirs."""

from __future__ import annotations

import base64
import itertools
import json
import zlib
from collections.abc import Callable
from functools import cache, cached_property
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib.image
import msgspec
import numpy as np
import pytest
import report_example as example

from integ_gym.eval.panel.result import Panel
from integ_gym.eval.report.episodes import (
    MOST_POLICIES,
    Episodes,
    Outcomes,
    Trace,
    choose_episodes,
    live_of,
)
from integ_gym.eval.report.page import render
from integ_gym.train.policy import BoxActions, MlpPolicy

MOST_BYTES, MOST_NODES = 1_200_000, 5_000
"""Of a page, unless it is of a large panel."""

PANELS: dict[str, Callable[[], dict[str, Any]]] = {
    "full": example.full_panel,
    "every verdict": example.every_verdict_panel,
    "given": example.build_given_panel,
    "nothing learned": example.nothing_learned_panel,
    "none": example.none_panel,
    "hostile": example.hostile_panel,
}
SAMPLES = 241
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


def episodes_of(panel: Panel, episodes: int = 20, trace_every: int = 4, seed: int = 0) -> Episodes:
    """Outcomes by the panel's rates, ledgers, and the traces that a page would choose."""
    rng = np.random.default_rng(seed)
    outcomes = {}
    for entry in panel.matrix:
        shape = (len(panel.row(entry.row).policies), episodes)
        names = [name for name in entry.labels if name != "none"] or ["planning_error"]
        won = rng.random(shape) < entry.success.estimate
        label = np.where(won, "none", rng.choice(names, shape))
        motor, numerics = rng.normal(8.0, 4.0, shape), rng.normal(0.0, 6.0, shape)
        time = np.where(won, rng.uniform(2.0, 8.0, shape), np.nan)
        traced = np.broadcast_to(np.arange(episodes) % trace_every == 0, shape)
        ledger = np.stack((motor, numerics, np.zeros(shape)))
        outcomes[entry.row, entry.cell] = Outcomes(label, ledger, time, traced)
    leads = choose_episodes(panel, outcomes)
    keys = {
        (lead.row, cell, lead.seed, lead.episode): lead for lead in leads for cell in lead.cells
    }
    traces = tuple(_trace(key, outcomes, rng) for key in keys)
    places = list(dict.fromkeys((lead.row, lead.seed) for lead in leads))[:MOST_POLICIES]
    live = live_of(panel, leads, {place: network(rng) for place in places})
    return Episodes(outcomes, tuple(leads), traces, live)


def network(rng: np.random.Generator, width: int = 64) -> MlpPolicy:
    """As large as PPO's, for the pendulum."""
    sizes = (3, width, width, 1)
    layers = tuple(
        (rng.normal(0.0, 0.3, (out, into)), rng.normal(0.0, 0.3, out))
        for into, out in itertools.pairwise(sizes)
    )
    return MlpPolicy(layers, "Tanh", BoxActions([-0.7], [0.7]))


def _trace(
    key: tuple[str, str, int, int],
    outcomes: dict[tuple[str, str], Outcomes],
    rng: np.random.Generator,
) -> Trace:
    row, cell, seed, episode = key
    own = outcomes[row, cell]
    label, totals = str(own.label[seed, episode]), own.ledger[:, seed, episode]
    share = np.sort(rng.random(SAMPLES))
    share = (share - share[0]) / (share[-1] - share[0])
    fields = {
        "record_id": rng.bytes(16).hex(),
        "length": SAMPLES - 1,
        "control_period": 0.05,
        "success": label == "none",
        "failure_label": label,
        "terminated": False,
        "solver_status": "ok",
        "command_error": None,
        "failure_reason": "" if label == "none" else f"it never came near on {cell}.",
        "time_to_success": None if label != "none" else float(own.time[seed, episode]),
        "return": -100.0,
        "initial_state": [3.2, 0.1],
        "energy_start": 0.05,
        "energy_end": 0.05 + float(totals[0] + totals[1] - totals[2]),
        "work_total": float(totals[0]),
        "energy_residual_total": float(totals[1]),
        "dissipated_total": float(totals[2]),
        "contact_loss_total": None,
        "clip_loss_total": 0.0,
    }
    return Trace(
        key,
        fields,
        0.05,
        {"theta": np.pi + np.cumsum(rng.normal(0.0, 0.2, SAMPLES))},
        {"torque_applied": 0.7 * np.sign(rng.normal(size=SAMPLES))},
        totals[:, None] * share,
    )
