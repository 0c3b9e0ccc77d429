"""Forests: lines of text, each with estimates and their intervals on a common axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ...panel.model.part import Estimate
from .axes import Axis

Tone: TypeAlias = Literal["fails", "transfers", "inconclusive", "not_learned", "soft", "accent"]
"""Colour of a mark, by its name in :data:`integ_gym.support.figures.PALETTE`."""


@dataclass(frozen=True)
class Mark:
    """An estimate drawn as a dot, with its interval if it has one.

    Attributes:
        value: the estimate.
        tone: its colour.
        filled: a ring where it is not.
        down: place across the line, from -1 at its upper edge to 1 at its lower.
    """

    value: Estimate
    tone: Tone
    filled: bool = True
    down: float = 0.0


@dataclass(frozen=True)
class Line:
    """One line of a forest.

    Attributes:
        row: shown before the cell; empty where the heading names it.
        cell: name of a cell.
        leads_to: row and cell of the entry that tells more.
        marks: later ones are drawn over earlier ones.
        number: the number that matters.
        detail: what else there is to say of it.
        words: all of it in words, for tooltips and screen readers.
        note: small print after the cell.
    """

    row: str
    cell: str
    leads_to: tuple[str, str]
    marks: tuple[Mark, ...]
    number: str
    detail: str
    words: str
    note: str = ""


@dataclass(frozen=True)
class Block:
    """Lines under a heading."""

    title: str
    lines: Sequence[Line]


@dataclass(frozen=True)
class Forest:
    """Blocks of lines on one axis.

    Attributes:
        title: of the figure.
        about: how to read it.
        along: what the axis shows.
        axis: of all lines.
        blocks: in order.
    """

    title: str
    about: str
    along: str
    axis: Axis
    blocks: tuple[Block, ...]
