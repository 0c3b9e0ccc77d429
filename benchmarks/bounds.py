"""One table of what is wanted of every benchmark and what it was, from the files that they wrote.

    python benchmarks/bounds.py runs/bench

Exits with 1 and names what was missed if a figure lies beyond its bound, or was not measured.
`benchmarks/measuring/bounds.py` declares them all.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from measuring import results
from measuring.bounds import BOUNDS, HEADER, judged


def main() -> int:
    """Print the table; 0 if every bound holds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="of the JSON files, named for the benchmarks")
    folder = parser.parse_args().folder
    rows, missed = [], []
    for benchmark in dict.fromkeys(bound.benchmark for bound in BOUNDS):
        file = folder / f"{benchmark}.json"
        if not file.exists():
            parser.error(f"there is no {file}; run `make bench`")
        for bound, value in judged(benchmark, json.loads(file.read_text(encoding="utf-8"))):
            rows.append(bound.row(value))
            if bound.verdict(value) in ("MISSED", "not measured"):
                missed.append(f"{bound.what} ({bound.verdict(value)})")
    results.print_table(HEADER, rows)
    if missed:
        print(f"\nMISSED: {'; '.join(missed)}", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
