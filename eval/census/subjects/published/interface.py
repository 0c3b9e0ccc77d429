"""What is told of a library of environments."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Protocol

from ..subject import Subject


class Library(Protocol):
    """A library that publishes a pendulum or a cart-pole."""

    title: ClassVar[str]
    """Its name, as people write it."""
    modules: ClassVar[tuple[str, ...]]
    """What has to be importable."""
    install: ClassVar[str]
    """The command that makes it so."""

    def subjects(self) -> Iterator[Subject]:
        """Its environments."""
