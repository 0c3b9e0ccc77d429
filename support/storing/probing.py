"""Whether claims can hold in an object store: it is tried before anything rests on it."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ..packages.extras import load
from ..sharing.probing import PROBE
from .objects import asking

ROUNDS, RIVALS = 4, 4
"""How often several threads try to make one object, and how many."""


def check_store(store: Any, url: str) -> None:
    """Check that a store keeps what claims rest on.

    An object is made by one of several that try, one that was changed is not replaced by who knows
    only what was there before, and a listing tells what was just written.

    Raises:
        ValueError: in one sentence, if not.
        OSError: if nothing can be written there.
    """
    obstore = load("obstore", "storage")
    place = f"{PROBE}{uuid.uuid4().hex}"
    try:
        with asking(url):
            obstore.put(store, f"{place}/written", b"")
        for fault, holds in _CHECKS.items():
            if not _holds(holds, store, place):
                raise ValueError(
                    f"{url} lies in a store that cannot be shared: {fault}; give a place in "
                    "another one (Amazon S3, Google Cloud Storage, Azure and MinIO do it), or a "
                    "directory"
                )
    finally:
        with asking(url):
            left = [str(one["path"]) for one in obstore.list(store, place).collect()]
            obstore.delete(store, left)


def _holds(check: Callable[[Any, str], bool], store: Any, place: str) -> bool:
    faults = load("obstore.exceptions", "storage")
    try:
        return check(store, place)
    except (faults.BaseError, OSError):  # what it does not do it may refuse in many ways
        return False


def _one_makes_an_object(store: Any, place: str) -> bool:
    """Of several that make one object, one alone is told that it did, and its content stays."""
    obstore = load("obstore", "storage")
    with ThreadPoolExecutor(RIVALS) as pool:
        for number in range(ROUNDS):
            name, start = f"{place}/{number}", threading.Barrier(RIVALS)
            tries = [pool.submit(_make, store, name, str(k), start) for k in range(RIVALS)]
            won = [str(rival) for rival, one in enumerate(tries) if one.result()]
            if won != [bytes(obstore.get(store, name).bytes()).decode()]:
                return False
    return not _make(store, f"{place}/0", "late", threading.Barrier(1))


def _make(store: Any, name: str, text: str, start: threading.Barrier) -> bool:
    obstore, faults = load("obstore", "storage"), load("obstore.exceptions", "storage")
    start.wait()
    try:
        obstore.put(store, name, text.encode(), mode="create")
    except faults.AlreadyExistsError:
        return False
    return True


def _changed_is_not_replaced(store: Any, place: str) -> bool:
    obstore, faults = load("obstore", "storage"), load("obstore.exceptions", "storage")
    name = f"{place}/changed"
    first = obstore.put(store, name, b"first")
    second = obstore.put(store, name, b"second", mode=_as_it_was(first))
    try:
        obstore.put(store, name, b"third", mode=_as_it_was(first))
    except faults.PreconditionError:
        obstore.put(store, name, b"fourth", mode=_as_it_was(second))
        return bytes(obstore.get(store, name).bytes()) == b"fourth"
    return False


def _as_it_was(made: Any) -> dict[str, Any]:
    return {key: made[key] for key in ("e_tag", "version") if made.get(key) is not None}


def _listing_tells(store: Any, place: str) -> bool:
    obstore = load("obstore", "storage")
    obstore.put(store, f"{place}/listed", b"")
    return f"{place}/listed" in {str(one["path"]) for one in obstore.list(store, place).collect()}


_CHECKS: dict[str, Callable[[Any, str], bool]] = {
    "it does not honour a conditional put (If-None-Match: *), so two processes can make one "
    "object": _one_makes_an_object,
    "it does not honour a conditional replacement (If-Match), so one process can undo what another "
    "wrote": _changed_is_not_replaced,
    "its listings lack what was just written": _listing_tells,
}
"""What is wrong with a store to what shows that it is not."""
