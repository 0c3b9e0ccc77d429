"""Who works in a place of an object store: one alone, or any number together.

A store has no lock that ends with its holder. Each that begins takes the next number, and has an
object touched for as long as it lasts; of two that begin at once one alone makes the number's
object. One that has been silent for its lease is taken for dead. Nothing rests on that being so:
what it began is ended by claims, which are made once; see `integ_gym.support.sharing.claims`.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..sharing.claims import LEASE
from ..sharing.holding import BEATS
from .objects import ObjectFiles
from .storage import Busy

SESSIONS = ".sessions"
_ALIVE, _OVER = "alive", "over"
_BETWEEN_LOOKS = 1.0
"""Of one that waits for whether another is dead, s."""


def over(number: str) -> str:
    """Name, in :data:`SESSIONS`, of what says that a session is over."""
    return f"{number}.{_OVER}"


class Sessions:
    """All who ever worked in a place.

    Args:
        files: of :data:`SESSIONS`.
        told: the place, for messages.
        lease: time of silence after which this one may be taken for dead, s.
    """

    def __init__(self, files: ObjectFiles, told: str, lease: float = LEASE) -> None:
        self._files = files
        self._told = told
        self._lease = lease

    @contextmanager
    def joined(self, alone: bool) -> Iterator[int]:
        """Work there, alone or together with others; the number of the session.

        A session of one is over with the block; one of many when its work is, see `Storage.end`.

        Raises:
            Busy: if somebody is there who does not let others, or whom one would not let.
        """
        number = self._begun(alone)
        ended = threading.Event()
        beats = threading.Thread(target=self._beat, args=(number, ended), daemon=True)
        beats.start()
        try:
            yield number
        finally:
            ended.set()
            beats.join()
            if alone:
                self._files.create(over(str(number)), "")
            self._files.close()

    def _begun(self, alone: bool) -> int:
        before = None
        while True:
            names = self._files.names("")
            latest = max((int(name) for name in names if name.isdecimal()), default=0)
            if latest == 0 or over(str(latest)) in names:
                if self._begins(latest + 1, alone):
                    return latest + 1
                continue
            kind = self._kind(latest)
            if not alone and not kind["alone"]:
                self._sign(latest)
                return latest
            heard = self._heard(latest)
            if before not in (None, heard):
                raise Busy
            wait = float(kind["lease"]) - (self._files.now() - heard)
            if wait <= 0.0 and self._begins(latest + 1, alone):
                return latest + 1
            if before is None and wait > 0.0:
                print(
                    f"{self._told}: another process was at work here, and may have been killed; "
                    f"waiting for at most {wait:.0f} s to see whether it still is",
                    file=sys.stderr,
                )
            before = heard
            time.sleep(_BETWEEN_LOOKS)

    def _begins(self, number: int, alone: bool) -> bool:
        kind = {
            "alone": alone,
            "lease": self._lease,
            "owner": f"{socket.gethostname()} {os.getpid()}",
        }
        return self._files.create(str(number), json.dumps(kind))

    def _kind(self, number: int) -> dict[str, Any]:
        return dict(json.loads(self._files.read(str(number)) or "{}"))

    def _heard(self, number: int) -> float:
        """When a session was last heard of, by the store's clock, s."""
        signs = (self._files.time_of(name) for name in (f"{number}.{_ALIVE}", str(number)))
        return max((sign for sign in signs if sign is not None), default=0.0)

    def _beat(self, number: int, ended: threading.Event) -> None:
        while not ended.wait(self._lease / BEATS):
            try:
                self._sign(number)
            except OSError:  # a store that does not answer for a while
                continue

    def _sign(self, number: int) -> None:
        """Have the session be heard of, unless it was a moment ago: a store limits writes."""
        if self._files.now() - self._heard(number) > self._lease / (2 * BEATS):
            self._files.write(f"{number}.{_ALIVE}", "")
