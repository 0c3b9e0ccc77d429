"""Declared experiments whose rows are published: blocks that resume, Parquet, a specification."""

from __future__ import annotations

import json
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from functools import cached_property
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from tqdm import tqdm

from integ_gym.eval.statistics import median_interval, unpaired_difference
from integ_gym.support.errors import InputError
from integ_gym.support.files import replace_file
from integ_gym.support.processes import cores
from integ_gym.support.terminal import plural
from integ_gym.train.fleet.training import preparation

from . import results

ROWS, SPECIFICATION, MADE_ON = "rows.parquet", "specification.json", "instruction_sets"

Row = dict[str, Any]


class Unit(Protocol):
    """What one process does at a time."""

    @property
    def block(self) -> str:
        """What `--only` chooses."""

    @property
    def name(self) -> str:
        """Unlike that of any other unit."""


@dataclass(frozen=True)
class Table:
    """An experiment.

    Rows of a cell have `successes` of `starts`, or a number in a column of another name.

    Attributes:
        columns: of its rows, to what they mean; the first ones say what a cell is.
        cell: how many columns say it.
        declared: all else that decides an outcome, and the tests, as JSON has it.
        packages: whose versions are stated.
        units: of seeds that follow a first one.
        first_seed: that was declared.
        run: one unit, to its rows without the column `unit`.
        value: the column of a row's number, where it has no successes.
        times: what is measured of the machine, as a cell's name says. Where there is any, one unit
            is run at a time, in a process that is not set up for training.
        lacking: why a unit cannot be run on this machine, empty where it can.
    """

    columns: Mapping[str, str]
    cell: int
    declared: Mapping[str, Any]
    packages: tuple[str, ...]
    units: Callable[[int], Sequence[Unit]]
    first_seed: int
    run: Callable[[Any], list[Row]]
    value: str | None = None
    times: tuple[str, ...] = ()
    lacking: Callable[[Any], str] = lambda unit: ""

    @property
    def cell_columns(self) -> tuple[str, ...]:
        """That say what a cell is."""
        return tuple(self.columns)[: self.cell]

    def specification(self, first_seed: int) -> dict[str, Any]:
        """What all rows of a folder have in common, and the instruction sets of this processor."""
        about = {
            "declared": {**self.declared, "first_seed": first_seed},
            "columns": {"unit": "what one process did at a time", **self.columns},
            **results.made_with(self.packages),
        }
        plain: dict[str, Any] = json.loads(json.dumps(about))
        return plain


@dataclass(frozen=True)
class Folder:
    """What a run has written.

    Attributes:
        path: of the folder, which need not be there.
    """

    path: Path

    def rows(self) -> list[Row]:
        """All there are."""
        file = self.path / ROWS
        found: list[Row] = pq.read_table(file).to_pylist() if file.exists() else []
        return found

    def specification(self) -> dict[str, Any]:
        """That was written; empty where nothing was run."""
        file = self.path / SPECIFICATION
        text = file.read_text(encoding="utf-8") if file.exists() else "{}"
        found: dict[str, Any] = json.loads(text)
        return found

    def claim(self, specification: Mapping[str, Any]) -> dict[str, list[str]]:
        """Let it be of one specification, whose processor is the only part that may differ.

        Returns:
            The instruction sets that blocks were made on, by block.

        Raises:
            ValueError: if it is of another specification.
        """
        found = self.specification()
        if not found:
            found = {**specification, MADE_ON: {}}
            self.describe(found)
        for name, value in specification.items():
            if name != MADE_ON and found[name] != value:
                raise InputError(
                    f"{self.path} was made with other {name.replace('_', ' ')}; give another "
                    "folder with --out"
                )
        made_on: dict[str, list[str]] = found[MADE_ON]
        return made_on

    def describe(self, specification: Mapping[str, Any]) -> None:
        """Write the specification."""
        content = json.dumps(specification, indent=1) + "\n"
        replace_file(self.path / SPECIFICATION, content.encode())

    def write(self, rows: Sequence[Row], columns: Mapping[str, str]) -> None:
        """In Parquet, what a column means beside its name, in an order of their own."""
        names = list(columns)
        ordered = sorted(rows, key=lambda row: [str(row[name]) for name in names])
        plain = pa.Table.from_pylist(ordered)
        fields = [plain.field(name).with_metadata({"meaning": columns[name]}) for name in names]
        sink = pa.BufferOutputStream()
        pq.write_table(plain.select(names).cast(pa.schema(fields)), sink, compression="zstd")
        replace_file(self.path / ROWS, sink.getvalue().to_pybytes())


def run_missing(
    table: Table,
    out: Path,
    first_seed: int,
    only: Sequence[str] | None = None,
    minutes: float = 60.0,
    workers: int = 1,
) -> int:
    """Run the units that a folder has not, until the time is over; each is written as it is done.

    Trained weights depend on the processor's instruction sets, so a block is of one kind of
    processor; another block may be of another.

    Args:
        table: the experiment.
        out: the folder.
        first_seed: of the units.
        only: blocks; None: all.
        minutes: after which nothing new is begun.
        workers: processes.

    Returns:
        How many units are left.

    Raises:
        ValueError: if the folder is of another specification, or a block that is begun of a
            processor with other instruction sets.
    """
    specification = table.specification(first_seed)
    folder, here = Folder(out), specification[MADE_ON]
    made_on, rows = folder.claim(specification), folder.rows()
    done = {row["unit"] for row in rows}
    wanted = [u for u in table.units(first_seed) if u.block in (only or [u.block])]
    lacking = {unit.name: why for unit in wanted if (why := table.lacking(unit))}
    wanted = [unit for unit in wanted if unit.name in done or unit.name not in lacking]
    left = deque(unit for unit in wanted if unit.name not in done)
    begun = {unit.block for unit in wanted if unit.name in done}
    for block in sorted(begun & {unit.block for unit in left}):
        if made_on[block] != here:
            raise InputError(
                f"block {block} of {folder.path} was begun on a processor with other instruction "
                "sets; end it there, or give another folder with --out"
            )
    missing, begins = len(left), time.monotonic()
    ends = begins + 60.0 * minutes
    prepared = (None, ()) if table.times else (preparation("cpu"), (0,))
    pool = ProcessPoolExecutor(workers, get_context("spawn"), *prepared)
    running: dict[Future[list[Row]], Unit] = {}
    with pool, tqdm(total=len(wanted), initial=len(wanted) - len(left), unit="unit") as bar:
        while True:
            while left and len(running) < workers and time.monotonic() < ends:
                unit = left.popleft()
                running[pool.submit(table.run, unit)] = unit
                bar.set_postfix_str(unit.name)
            if not running:
                break
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                unit = running.pop(future)
                rows += [{"unit": unit.name, **row} for row in future.result()]
                if made_on.get(unit.block) != here:
                    made_on[unit.block] = here
                    folder.describe({**specification, MADE_ON: made_on})
                folder.write(rows, specification["columns"])
                bar.update()
    for name, why in lacking.items():
        if name not in done:
            print(f"{name} is left out: {why}")
    print(
        f"{plural(missing - len(left), 'unit')} in {(time.monotonic() - begins) / 60.0:.1f} min "
        f"with {plural(workers, 'process', 'processes')}",
        file=sys.stderr,
    )
    return len(left)


@dataclass(frozen=True)
class Cells:
    """Rows by what they are of.

    Attributes:
        rows: all of them.
        names: of the columns that say what a cell is.
    """

    rows: Sequence[Row]
    names: tuple[str, ...]

    @cached_property
    def by_cell(self) -> dict[tuple[Any, ...], list[Row]]:
        """Rows of every cell, by seed."""
        found: dict[tuple[Any, ...], list[Row]] = {}
        for row in sorted(self.rows, key=lambda row: row["seed"]):
            found.setdefault(tuple(row[name] for name in self.names), []).append(row)
        return found

    def rates(self, *cell: Any) -> list[float]:
        """Success rate of every seed; empty where nothing was run."""
        return [row["successes"] / row["starts"] for row in self.by_cell.get(cell, [])]


def tabulate_success(
    table: Table,
    rows: Sequence[Row],
    first_seed: int,
    what: str,
    values: Sequence[float],
    arms: Sequence[str | float],
    tabulate_tests: Callable[[Cells], list[str]],
) -> str:
    """Success by what is varied and by arm, and the tests if all was run, as Markdown.

    Args:
        table: the experiment; its cells are a value and an arm.
        rows: of a run.
        first_seed: of that run.
        what: is varied.
        values: of it.
        arms: that are compared.
        tabulate_tests: lines of the table of the declared tests.
    """
    cells = Cells(rows, table.cell_columns)
    success = [
        [f"{value:g}", *[results.format_success(cells.rates(value, arm)) for arm in arms]]
        for value in values
    ]
    names = [arm if isinstance(arm, str) else f"{arm:g}" for arm in arms]
    lines = results.markdown([what, *names], success)
    if {unit.name for unit in table.units(first_seed)} <= {row["unit"] for row in rows}:
        lines += ["", *tabulate_tests(cells)]
    return "\n".join(lines) + "\n"


def seconds_of_policies(rows: Sequence[Row]) -> dict[tuple[str, int], float]:
    """Processor time of the training of each policy, s, by unit and seed.

    Args:
        rows: of a run, with `cpu_seconds`.
    """
    return {(row["unit"], row["seed"]): row["cpu_seconds"] for row in rows}


def tabulate_blocks(
    table: Table, rows: Sequence[Row], first_seed: int, counted: str, size: Callable[[Any], int]
) -> list[str]:
    """How much of each block was run, and the processor time of its training, as Markdown.

    Args:
        table: the experiment.
        rows: of a run, with `cpu_seconds` of each policy.
        first_seed: of that run.
        counted: what is counted, in the plural.
        size: how many of these a unit has.
    """
    units_of: dict[str, list[Unit]] = {}
    for unit in table.units(first_seed):
        units_of.setdefault(unit.block, []).append(unit)
    spent = seconds_of_policies(rows)
    done = {name for name, _ in spent}
    lines = []
    for block, units in units_of.items():
        names = {unit.name for unit in units}
        seconds = sum(value for (name, _), value in spent.items() if name in names)
        run = sum(size(unit) for unit in units if unit.name in done)
        lines.append((block, f"{run} of {sum(map(size, units))}", f"{seconds / 60.0:.0f}"))
    return results.markdown(("block", f"{counted} that were run", "training, core-minutes"), lines)


def format_median(
    numbers: Sequence[float], format_number: Callable[[float], str] = "{:.1e}".format
) -> str:
    """Median of starts with its interval, as Markdown; the number where it is one.

    Args:
        numbers: of the starts; infinite where a motion was lost.
        format_number: one of them.
    """
    found = median_interval(numbers)
    if found is None:
        return format_number(numbers[0])
    ends = (found.estimate, found.low, found.high)
    middle, low, high = ("lost" if x is None else format_number(x) for x in ends)
    return f"{middle} ({low}–{high})"


def medians_agree(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether the intervals of two medians, each of several numbers, have a number in common."""
    first, second = median_interval(one), median_interval(other)
    assert first is not None
    assert second is not None
    ends = (first.low, first.high, second.low, second.high)
    low_1, high_1, low_2, high_2 = (np.inf if x is None else x for x in ends)
    return bool(low_1 <= high_2 and low_2 <= high_1)


def compare(table: Table, one: Folder, other: Folder) -> list[str]:
    """Cells of several rows that both have, without times, and which of them are apart.

    Success is apart where the 95 % interval of the difference excludes 0, and a number where the
    intervals of the medians have no number in common.
    """
    ours, theirs = (Cells(folder.rows(), table.cell_columns) for folder in (one, other))
    shared = [
        cell
        for cell, rows in ours.by_cell.items()
        if min(len(rows), len(theirs.by_cell.get(cell, []))) > 1 and not {*cell} & {*table.times}
    ]
    lines, apart = [], 0
    for cell in shared:
        if table.value is not None:
            numbers = [
                [row[table.value] for row in cells.by_cell[cell]] for cells in (ours, theirs)
            ]
            if not medians_agree(*numbers):
                apart += 1
                lines.append(f"apart: {cell}: {' and '.join(map(format_median, numbers))}")
            continue
        pair = [cells.rates(*cell) for cells in (ours, theirs)]
        found = unpaired_difference(*pair).interval
        if found.low is None or found.high is None or not found.low <= 0.0 <= found.high:
            apart += 1
            shown = " and ".join(map(results.format_success, pair))
            lines.append(f"apart: {cell}: {shown}")
    return [*lines, f"{len(shared) - apart} of {len(shared)} cells agree within 95 %"]


def command(
    table: Table,
    tables: Callable[[list[Row], int], str],
    what: str | None,
    figure: Callable[[list[Row], Path], object] | None = None,
) -> None:
    """Run what is missing, print what was found, draw it; status 1 where units are left.

    Args:
        table: the experiment.
        tables: of the page, as Markdown, from rows and their first seed.
        what: the script's docstring.
        figure: writes the page's figure, in every format, to a path without a suffix.
    """
    parser = results.parser(what)
    blocks = list(dict.fromkeys(unit.block for unit in table.units(table.first_seed)))
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="rows and specification")
    add("--only", nargs="+", choices=blocks, metavar="BLOCK", help=f"of {', '.join(blocks)}")
    add("--minutes", type=float, default=60.0, metavar="N", help="then begin nothing new: 60")
    workers = 1 if table.times else cores()
    add("--workers", type=int, default=workers, metavar="N", help=f"processes: {workers}")
    add("--first-seed", type=int, default=table.first_seed, metavar="N", help="for a repetition")
    add("--table", action="store_true", help="run nothing: print the page's tables")
    add("--against", type=Path, metavar="DIR", help="run nothing: compare with another run")
    if figure is not None:
        add("--figure", type=Path, metavar="PATH", help="run nothing: draw PATH.png, .svg and .pdf")
    given = parser.parse_args()
    folder = Folder(given.out)
    if given.against:
        print("\n".join(compare(table, folder, Folder(given.against))))
        return
    if figure is not None and given.figure:
        figure(folder.rows(), given.figure)
        return
    left = 0
    if not given.table:
        try:
            left = run_missing(
                table, given.out, given.first_seed, given.only, given.minutes, given.workers
            )
        except InputError as error:
            parser.error(str(error))
    found = folder.specification()
    first_seed = found["declared"]["first_seed"] if found else given.first_seed
    print(tables(folder.rows(), first_seed), end="")
    if left:
        are = "is" if left == 1 else "are"
        sys.exit(f"{plural(left, 'unit')} {are} left: run the same command again.")
