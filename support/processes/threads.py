"""Work that is done beside other work, in a thread."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Final, TypeVar

Item = TypeVar("Item")

_END: Final = object()


def ahead(items: Iterator[Item]) -> Iterator[Item]:
    """The same items, each made in another thread while the one before is used.

    What the making of one raises is raised in its place. At the end of the process, when no thread
    can be started any more, they are made when they are wanted.
    """
    with ThreadPoolExecutor(1) as thread:
        try:
            following = thread.submit(next, items, _END)
        except RuntimeError:
            yield from items
            return
        while (item := following.result()) is not _END:
            following = thread.submit(next, items, _END)
            yield item  # type: ignore[misc]
