"""What claims cost a shared directory: their real code over a simulated file server and clock.

    python benchmarks/claims.py [--units 100000] [--workers 1000] [--json FILE]

All workers start at once and take units of about a minute by claims, as `integ-gym panel --worker`
does. They fail at a rate: half of those that fail are killed and replaced later, half stop for
twice a lease and wake. Counted is what the file server is asked for: one request for each of its
operations, and of a listing one for every hundred names.
"""

from __future__ import annotations

import argparse
import heapq
import math
import random
import resource
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

from measuring import results

from integ_gym.support.sharing.claims import Claims
from integ_gym.support.sharing.holding import BEATS, pauses

EXAMPLES = """\
examples:
  python benchmarks/claims.py                                 some minutes, on one core
  python benchmarks/claims.py --units 2000 --workers 50       a quick look
  python benchmarks/claims.py --failures 50 --lease 60        half of the workers in an hour
"""

NAMES_A_REQUEST = 100
"""Names that a file server tells in one answer."""

REQUESTS = {"create": 5, "read": 2, "exists": 1, "touch": 1, "age": 2, "put in place": 12}
"""Requests of an operation: a file is looked for, made under another name, written, linked, and
unlinked, or found to be there; an age is that of an opened file (the clock that it is held against
is asked every five minutes by each worker, which is not counted); a unit's four files are moved
into folders that are looked up."""

REPLACED = 300.0
"""Time until a killed worker is replaced, s."""

SPREAD = 0.3
"""Standard deviation of the logarithm of what a unit takes."""


@dataclass
class Server:
    """Files in memory, a clock, and a count of what is asked for.

    Attributes:
        now: time, s.
        folders: text and time of each file, by folder.
        requests: by kind of operation.
        by_second: all requests, by the second in which they came.
        names_listed: names told in listings.
    """

    now: float = 0.0
    folders: dict[str, dict[str, tuple[str, float]]] = field(default_factory=dict)
    requests: Counter[str] = field(default_factory=Counter)
    by_second: Counter[int] = field(default_factory=Counter)
    names_listed: int = 0

    def count(self, kind: str, requests: int | None = None) -> None:
        """Note an operation."""
        asked = REQUESTS[kind] if requests is None else requests
        self.requests[kind] += asked
        self.by_second[int(self.now)] += asked

    def create(self, name: str, text: str) -> bool:
        """See `SharedFiles`."""
        folder, own = self._place(name)
        if own in folder:
            self.count("exists")
            return False
        self.count("create")
        folder[own] = text, self.now
        return True

    def read(self, name: str) -> str | None:
        """See `SharedFiles`."""
        self.count("read")
        folder, own = self._place(name)
        return folder[own][0] if own in folder else None

    def exists(self, name: str) -> bool:
        """See `SharedFiles`."""
        self.count("exists")
        folder, own = self._place(name)
        return own in folder

    def touch(self, name: str) -> None:
        """See `SharedFiles`."""
        self.count("touch")
        folder, own = self._place(name)
        folder[own] = folder[own][0], self.now

    def age(self, name: str) -> float | None:
        """See `SharedFiles`."""
        self.count("age")
        folder, own = self._place(name)
        return self.now - folder[own][1] if own in folder else None

    def names(self, folder: str) -> list[str]:
        """See `SharedFiles`."""
        found = list(self.folders.get(folder, ()))
        self.names_listed += len(found)
        self.count("list", 1 + math.ceil(len(found) / NAMES_A_REQUEST))
        return found

    def _place(self, name: str) -> tuple[dict[str, tuple[str, float]], str]:
        folder, _, own = name.rpartition("/")
        return self.folders.setdefault(folder, {}), own


@dataclass
class Fleet:
    """Workers, their failures, and what came of the units.

    Attributes:
        server: that they share.
        units: names of all.
        seconds: that a unit takes in the median.
        lease: s.
        rate: of failures of one worker, per second.
        rng: of durations and failures.
        commits: how often each unit was committed.
        refused: commits of workers that had lost their lease.
        killed: workers.
        stopped: workers that woke after their lease.
        idle: time of workers that found nothing to do, s.
    """

    server: Server
    units: list[str]
    seconds: float
    lease: float
    rate: float
    rng: random.Random
    commits: Counter[str] = field(default_factory=Counter)
    refused: int = 0
    killed: int = 0
    stopped: int = 0
    idle: float = 0.0

    def worker(self, seed: int) -> Iterator[float]:
        """A worker: yields how long it does nothing that the server sees."""
        claims = Claims(self.server, self.units, self.lease, seed, lambda: self.server.now)
        waits = pauses(self.lease, random.Random(seed))
        while not claims.done:
            claim = claims.take()
            if claim is None:
                pause = 0.0 if claims.done else next(waits)
                self.idle += pause
                yield pause
                continue
            if not claim.decided:
                left = self.seconds * self.rng.lognormvariate(0.0, SPREAD)
                while left > 0.0:
                    yield min(left, self.lease / BEATS)
                    left -= self.lease / BEATS
                    claim.renew()
            if not claim.commit():
                self.refused += 1
                continue
            self.commits[claim.unit] += not claim.decided
            self.server.count("put in place")
            claim.finish()
            waits = pauses(self.lease, self.rng)

    def run(self, workers: int) -> float:
        """Until all workers have ended; when the last unit was committed, s."""
        order = count()
        events = [
            (0.0, next(order), self.worker(seed), self._fails(0.0)) for seed in range(workers)
        ]
        heapq.heapify(events)
        last = 0.0
        while events:
            now, _, worker, fails = heapq.heappop(events)
            self.server.now = now
            if now >= fails and self.rng.random() < 0.5:
                self.killed += 1
                fresh = self.worker(workers + next(order))
                entry = (now + REPLACED, next(order), fresh, self._fails(now + REPLACED))
                heapq.heappush(events, entry)
                continue
            pause = 0.0
            if now >= fails:
                self.stopped += 1
                pause, fails = 2.0 * self.lease, self._fails(now)
            if pause:
                heapq.heappush(events, (now + pause, next(order), worker, fails))
                continue
            before = len(self.commits)
            wait = next(worker, None)
            if len(self.commits) > before:
                last = now
            if wait is not None:
                heapq.heappush(events, (now + wait, next(order), worker, fails))
        return last

    def _fails(self, now: float) -> float:
        return now + self.rng.expovariate(self.rate) if self.rate else math.inf


def simulated(given: argparse.Namespace) -> tuple[dict[str, Any], list[list[str]]]:
    """What came of it, and as rows."""
    server, begun = Server(), time.perf_counter()
    units = [f"train-policy-{number}" for number in range(given.units)]
    rate = given.failures / 100.0 / 3600.0
    fleet = Fleet(server, units, given.seconds, given.lease, rate, random.Random(given.seed))
    last = fleet.run(given.workers)
    least = given.units * given.seconds * math.exp(SPREAD**2 / 2.0) / given.workers
    whole = sum(server.requests.values())
    minutes: Counter[int] = Counter()
    for second, asked in server.by_second.items():
        minutes[second // 60] += asked
    found = {
        "units": given.units,
        "workers": given.workers,
        "committed_once": sum(times == 1 for times in fleet.commits.values()),
        "committed_more_than_once": sum(times > 1 for times in fleet.commits.values()),
        "killed": fleet.killed,
        "stopped_and_woken": fleet.stopped,
        "commits_refused": fleet.refused,
        "seconds": last,
        "seconds_without_any_loss": least,
        "idle_share": fleet.idle / (given.workers * server.now),
        "requests": dict(server.requests),
        "requests_per_unit": whole / given.units,
        "requests_per_second": {
            "mean": whole / server.now,
            "busiest_minute": max(minutes.values()) / 60.0,
            "busiest_second": max(server.by_second.values()),
        },
        "names_listed_per_second": server.names_listed / server.now,
        "simulation": {
            "seconds": time.perf_counter() - begun,
            "mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        },
    }
    return found, _rows(found)


def _rows(found: dict[str, Any]) -> list[list[str]]:
    rate = found["requests_per_second"]
    return [
        ["units committed once", f"{found['committed_once']} of {found['units']}"],
        ["units committed more than once", str(found["committed_more_than_once"])],
        ["workers killed and replaced", str(found["killed"])],
        ["workers stopped beyond their lease", str(found["stopped_and_woken"])],
        ["commits refused to these", str(found["commits_refused"])],
        ["time to the last commit", f"{found['seconds']:.0f} s"],
        ["the same without failures or waiting", f"{found['seconds_without_any_loss']:.0f} s"],
        ["requests per unit", f"{found['requests_per_unit']:.1f}"],
        ["requests per second, mean", f"{rate['mean']:.0f}"],
        ["requests per second, busiest minute", f"{rate['busiest_minute']:.0f}"],
        ["requests in the busiest second", f"{rate['busiest_second']:.0f}"],
        ["names listed per second", f"{found['names_listed_per_second']:.0f}"],
        ["simulation", f"{found['simulation']['seconds']:.0f} s"],
        ["its memory", f"{found['simulation']['mib']:.0f} MiB"],
    ]


def main() -> None:
    """Print the table; write JSON where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--units", type=int, default=100_000, metavar="N", help="(default: 100000)")
    add("--workers", type=int, default=1000, metavar="N", help="(default: 1000)")
    add("--seconds", type=float, default=60.0, metavar="S", help="of a unit (default: 60)")
    add("--lease", type=float, default=120.0, metavar="S", help="(default: 120)")
    add("--failures", type=float, default=1.0, metavar="PERCENT", help="in an hour (default: 1)")
    add("--seed", type=int, default=0, metavar="N", help="of the simulation (default: 0)")
    add("--json", type=Path, metavar="FILE", help="also write the numbers here")
    given = parser.parse_args()
    found, rows = simulated(given)
    results.write(given.json, {"found": found, "requests_of": REQUESTS}, ("integ-gym",))
    results.print_table(("claims", "found"), rows)


if __name__ == "__main__":
    main()
