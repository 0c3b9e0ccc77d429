"""Whether two versions of the code give the same outcomes, so that summaries may be combined."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from integ_gym.support import replace_file

from .summary import Summary

FILE = "agreements.json"
"""Beside the summaries."""


class Agreement(msgspec.Struct, frozen=True):
    """Code that gave the same outcomes as other code where both were run.

    Attributes:
        codes: both versions.
        block: name of what was run again.
        policies: that were trained again.
        rows: policies times cells that were compared.
    """

    codes: tuple[str, str]
    block: str
    policies: int
    rows: int


def compare(name: str, first: Summary, again: Summary) -> Agreement:
    """Hold what was run again against what there was.

    Args:
        name: of the block.
        first: its summary.
        again: of all or some of the same policies.

    Raises:
        ValueError: naming the first outcome that differs.
    """
    known = {_key(row): row for row in first.rows.to_pylist()}
    rows = again.rows.to_pylist()
    for row in rows:
        before = known.get(_key(row))
        different = [n for n in row if before is None or row[n] != before[n]]
        if different:
            raise ValueError(
                f"block {name}, seed {row['seed']} of {row['home']} in {row['cell']}: "
                f"{', '.join(different)} differ between code {first.origin.code} and "
                f"{again.origin.code}; their summaries cannot be combined"
            )
    policies = len({(row["home"], row["seed"]) for row in rows})
    return Agreement((first.origin.code, again.origin.code), name, policies, len(rows))


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
