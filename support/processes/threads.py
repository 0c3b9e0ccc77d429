"""Work that is done beside other work, in a thread."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing import parent_process
from typing import Any, Final, TypeVar

Item = TypeVar("Item")

_END: Final = object()


def ahead(items: Iterator[Item]) -> Iterator[Item]:
    """The same items, each made in another thread while the one before is used.

    What the making of one raises is raised in its place. In a worker, which has one thread, and at
    the end of the process, when none can be started any more, they are made when they are wanted.
    """
    if parent_process() is None:
        with ThreadPoolExecutor(1) as thread:
            following = _submitted(thread, items)
            while following is not None:
                item = following.result()
                if item is _END:
                    return
                following = _submitted(thread, items)
                yield item
    yield from items


def _submitted(thread: ThreadPoolExecutor, items: Iterator[Any]) -> Future[Any] | None:
    """The next item, or the end; None where the interpreter starts no thread any more."""
    try:
        return thread.submit(next, items, _END)
    except RuntimeError:
        return None
