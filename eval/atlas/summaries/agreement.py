"""Whether two versions of the code give the same outcomes, so that summaries may be combined."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from integ_gym.support.files import replace_file

from ...statistics.interval import Interval
from ...statistics.scalars import mean_interval
from .summary import Summary

FILE = "agreements.json"
"""Beside the summaries."""

MARGIN = 0.05
"""Largest difference of mean success that is let pass as none."""


class Agreement(msgspec.Struct, frozen=True):
    """Two versions of the code, and how a block that both ran came out.

    Attributes:
        codes: both versions.
        block: name of what was run again.
        policies: that were trained again.
        rows: policies times cells that were compared.
        difference: of mean success over all rows, again less before, and its 95 % interval over
            seeds; None: every outcome and every policy was the same.
    """

    codes: tuple[str, str]
    block: str
    policies: int
    rows: int
    difference: tuple[float, float, float] | None = None


def compare(name: str, first: Summary, again: Summary) -> Agreement:
    """Hold what was run again against what there was.

    The same processor gives the same policies to the last bit. Another rounds otherwise, and
    training does not forget it. A whole block then agrees if the 95 % interval of the difference of
    mean success lies within `MARGIN`, and no training ground's differs by more than chance.

    Args:
        name: of the block.
        first: its summary.
        again: of all or some of the same policies.

    Raises:
        ValueError: naming the first outcome that differs, where the processor is known to be the
            same or not the whole block was run again; else what differs by more than chance.
    """
    told = first_difference(first, again)
    before, after = first.rows.to_pylist(), again.rows.to_pylist()
    codes = (first.origin.code, again.origin.code)
    difference = None
    if told is not None:
        whole = {_key(row) for row in before} == {_key(row) for row in after}
        if same_processor(first, again) or not whole:
            raise ValueError(f"block {name}, {told} differ between code {' and '.join(codes)}")
        found = _by_chance(name, _success(before), _success(after))
        difference = (found.estimate, found.low, found.high)
    policies = len({(row["home"], row["seed"]) for row in after})
    return Agreement(codes, name, policies, len(after), difference)


def same_processor(first: Summary, again: Summary) -> bool:
    """Whether both were run on processors that are known to compute alike."""
    known = first.origin.instruction_sets
    return bool(known) and known == again.origin.instruction_sets


def first_difference(first: Summary, again: Summary) -> str | None:
    """The first outcome that is not what it was, in words; None: all that was run again is."""
    known = {_key(row): row for row in first.rows.to_pylist()}
    for row in again.rows.to_pylist():
        old = known.get(_key(row))
        different = [name for name in row if old is None or row[name] != old[name]]
        if different:
            return f"seed {row['seed']} of {row['home']} in {row['cell']}: {', '.join(different)}"
    return None


def _success(rows: Sequence[Mapping[str, Any]]) -> dict[str, npt.NDArray[np.float64]]:
    """Mean success over cells, by training ground, shape (seeds,)."""
    found: dict[str, dict[int, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        found[row["home"]][row["seed"]].append(row["successes"] / row["episodes"])
    return {
        home: np.array([fmean(seeds[seed]) for seed in sorted(seeds)])
        for home, seeds in found.items()
    }


def _by_chance(
    name: str,
    before: Mapping[str, npt.NDArray[np.float64]],
    after: Mapping[str, npt.NDArray[np.float64]],
) -> Interval:
    """Difference of mean success over all, with its interval over seeds.

    Raises:
        ValueError: where it, or that of one training ground, is more than chance.
    """
    changes = {home: after[home] - before[home] for home in before}
    for home, values in changes.items():
        found = _interval(values, 1.0 - 0.05 / len(changes))
        if found.low > 0.0 or found.high < 0.0:
            raise ValueError(f"block {name}, success of {home} is another: by {found}")
    overall = _interval(np.mean(list(changes.values()), axis=0), 0.95)
    if max(-overall.low, overall.high) > MARGIN:
        raise ValueError(f"block {name}, success may be another: by {overall}")
    return overall


def _interval(values: npt.NDArray[np.float64], level: float) -> Interval:
    found = mean_interval(values, level)
    if found is None:
        raise ValueError("one seed tells nothing of what another processor changes")
    return found


def note(agreement: Agreement, folder: Path) -> None:
    """Add an agreement to those of a folder of summaries."""
    noted = [one for one in noted_in(folder) if one != agreement]
    content = msgspec.json.format(msgspec.json.encode([*noted, agreement]), indent=1)
    replace_file(folder / FILE, content + b"\n")


def noted_in(folder: Path) -> list[Agreement]:
    """The agreements of a folder of summaries."""
    file = folder / FILE
    return msgspec.json.decode(file.read_bytes(), type=list[Agreement]) if file.exists() else []


def check_agree(summaries: Sequence[Summary], agreements: Iterable[Agreement]) -> None:
    """Refuse to combine summaries of code that was never held against each other.

    Raises:
        ValueError: naming two such versions.
    """
    codes = list(dict.fromkeys(one.origin.code for one in summaries))
    reached, pairs = set(codes[:1]), [set(one.codes) for one in agreements]
    while grown := {code for pair in pairs if pair & reached for code in pair} - reached:
        reached |= grown
    apart = [code for code in codes if code not in reached]
    if apart:
        raise ValueError(
            f"summaries of code {codes[0]} and {apart[0]} were never held against each other; run "
            "a block again with `integ-gym atlas SPEC --again BLOCK`"
        )


def _key(row: dict[str, object]) -> tuple[object, ...]:
    return row["home"], row["seed"], row["cell"]
