"""What attacks on runs come to: nothing lost, doubled or wrongly accepted, and all named.

    python benchmarks/attacks.py [--tries 1000] [--seed 0] [--only WORD] [--json FILE]

Every try attacks a copy of a small finished panel, reads a stranger's file, or disturbs a run and
finishes it. The tests in tests/reliability try the same attacks, a few times each. It ends with 1
if anything was not as promised. A failure: not named by `integ-gym evidence verify`, not refused in
one sentence, not to be finished, or files left over. Lost and doubled are records of finished runs;
accepted are wrong results that `integ-gym report` or `panel` took.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from measuring import results

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers" / "reliability"))

from damage import DAMAGES
from forgery import FORGERIES
from hostile import HOSTILE
from interruption import INTERRUPTIONS
from trials import tried
from victim import Victim, make_victim

PACKAGES = ("integ-gym", "gymnasium", "numpy", "pyarrow", "duckdb", "torch")

SHARES = (
    (DAMAGES, "file {}", 0.25),
    (FORGERIES, "{}", 0.06),
    (FORGERIES, "{}, all made to fit", 0.06),
    ([kind for kind in HOSTILE if kind != "record"], "hostile {}", 0.57),
    (["record"], "hostile {}", 0.03),
    (INTERRUPTIONS, "{}", 0.03),
)
"""Attacks of a kind, their names, and what share of the tries they have together."""


def shares(tries: int) -> dict[str, int]:
    """How often each attack is tried, at least once."""
    return {
        name.format(kind): max(1, -(-round(tries * share) // len(kinds)))
        for kinds, name, share in SHARES
        for kind in kinds
    }


def attacked(name: str, tries: int, seed: int, victim: Victim) -> dict[str, Any]:
    """What an attack came to."""
    start = time.perf_counter()
    outcomes = [tried(name, seed + k, victim, victim.folder / "try") for k in range(tries)]
    return {
        "attack": name,
        "tries": tries,
        "failures": sum(bool(one.failures) for one in outcomes),
        "lost": sum(one.lost for one in outcomes),
        "doubled": sum(one.doubled for one in outcomes),
        "accepted": sum(bool(one.accepted) for one in outcomes),
        "seconds": time.perf_counter() - start,
        "details": [
            f"{one.note}: {'; '.join((*one.failures, *one.accepted))}"[:500]
            for one in outcomes
            if not one.held
        ],
    }


COLUMNS = ("attack", "tries", "failures", "lost", "doubled", "accepted")


def _rows(found: list[dict[str, Any]]) -> Iterator[list[str]]:
    for row in found:
        yield [str(row[name]) for name in COLUMNS]
    yield ["all", *(str(sum(row[name] for row in found)) for name in COLUMNS[1:])]


def main() -> int:
    """Print the table; write JSON where asked."""
    parser = results.parser(__doc__, file=True)
    parser.add_argument("--tries", type=int, default=1000, help="in all, about")
    parser.add_argument("--seed", type=int, default=0, help="of the first try of each attack")
    parser.add_argument("--only", default="", metavar="WORD", help="attacks with this in the name")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        victim = make_victim(Path(folder))
        chosen = {name: k for name, k in shares(given.tries).items() if given.only in name}
        found = []
        for name, tries in chosen.items():
            print(f"{name} …", file=sys.stderr)
            found.append(attacked(name, tries, given.seed, victim))
    results.print_table(COLUMNS, _rows(found))
    for row in found:
        for detail in row["details"]:
            print(f"{row['attack']}: {detail}", file=sys.stderr)
    content = {"seed": given.seed, "attacks": found}
    results.write(given.json, content, PACKAGES)
    return int(any(row["details"] for row in found))


if __name__ == "__main__":
    sys.exit(main())
