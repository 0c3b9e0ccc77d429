"""``integ-gym atlas``: one panel over many limits of the control, block by block."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from integ_gym.eval.atlas.running import again, missing, publish, run_blocks
from integ_gym.eval.atlas.specification import Atlas, Block, read_atlas
from integ_gym.eval.atlas.summaries import Agreement
from integ_gym.eval.panel.costs import policy_costs, total_cost
from integ_gym.support.errors import InputError
from integ_gym.support.options import CommandParser
from integ_gym.support.terminal import plural, print_columns, print_wrapped, seconds

from .work_options import add_work, workers_of

EXAMPLES = """\
examples:
  integ-gym atlas specs/atlas/rod_pendulum.toml --plan
                                  blocks that are there, cost of the others
  integ-gym atlas specs/atlas/rod_pendulum.toml --out runs/atlas
                                  run what is missing, or was interrupted
  integ-gym atlas specs/atlas/rod_pendulum.toml --out runs/atlas \\
      --only 1.7-seed2000
  integ-gym atlas specs/atlas/rod_pendulum.toml \\
      --summaries docs/atlas/rod_pendulum --publish runs/rod_pendulum
                                  diagram, table and losses from the summaries
  integ-gym atlas specs/atlas/rod_pendulum.toml --out runs/again \\
      --again 1.7-seed2000
                                  train it once more, and compare every outcome
"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = CommandParser(
        prog="integ-gym atlas",
        description="Run one panel at several limits of the control, in blocks of a few training "
        "seeds each. A finished block leaves a summary of one row per policy and cell, and is not "
        "run again.",
        epilog=EXAMPLES,
    )
    add = arguments.add_argument
    add("spec", type=Path, help="TOML file, see docs/reference/atlas.md")
    add("--out", type=Path, metavar="DIR", help="where the runs of the blocks go")
    add(
        "--summaries", type=Path, metavar="DIR",
        help="folder of the summaries; default: `summaries` in --out",
    )  # fmt: skip
    add("--plan", action="store_true", help="run nothing: say what is there and what is missing")
    add("--only", nargs="+", metavar="BLOCK", help="run these blocks alone")
    add(
        "--again", metavar="BLOCK",
        help="train the first two seeds of a finished block again, or all its seeds if the first "
        "two come out otherwise on another processor; if the outcomes agree, note it in the "
        "summaries' folder",
    )  # fmt: skip
    add(
        "--publish", type=Path, metavar="DIR",
        help="run nothing: write phase diagram, table and losses from the summaries",
    )  # fmt: skip
    add_work(arguments)
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    workers = workers_of(given)
    atlas = read_atlas(given.spec)
    reads = given.plan or given.publish
    if given.out is None and not (reads and given.summaries):
        raise InputError("an atlas needs a directory: --out DIR")
    folder = given.summaries or given.out / "summaries"
    waiting = missing(atlas, folder)
    if given.publish:
        files = publish(atlas, folder, given.publish)
        names = ", ".join(path.name for path in files)
        print_wrapped(f"Written to {given.publish}: {names}")
        return 0
    if given.plan:
        _print_plan(atlas, waiting)
        return 0
    if given.again:
        block = _find_block(atlas.blocks(), given.again)
        agreement = again(atlas, block, given.out, folder, workers=workers)
        print_wrapped(_format_agreement(agreement))
        return 0
    chosen = [_find_block(atlas.blocks(), name) for name in given.only or ()]
    blocks = [one for one in waiting if not chosen or one in chosen]
    progress = not given.no_progress
    for block, summary in run_blocks(
        atlas, blocks, given.out, folder, workers=workers, progress=progress
    ):
        print(f"{block.name}: {summary.rows.num_rows} rows", flush=True)
        print(f"Seal: {summary.origin.seal}", flush=True)
    left = len(missing(atlas, folder))
    print(f"{len(atlas.blocks()) - left} of {len(atlas.blocks())} blocks are in {folder}")
    return 0


def _format_agreement(found: Agreement) -> str:
    what = f"{plural(found.policies, 'policy', 'policies')} trained again in {found.block}"
    if found.difference is None:
        return f"{what}: all {found.rows} outcomes are the same."
    mean, low, high = found.difference
    by = f"mean success differs by {mean:z.3f} (95 % interval {low:z.3f} to {high:z.3f})"
    return f"{what}: other weights, but {by}, and by no more than chance on any training ground."


def _find_block(blocks: Sequence[Block], name: str) -> Block:
    for block in blocks:
        if block.name == name:
            return block
    raise InputError(f"there is no block {name!r}; --plan lists them")


def _print_plan(atlas: Atlas, waiting: Sequence[Block]) -> None:
    """Every block, and what those that are missing cost."""
    costs = {one.name: total_cost(policy_costs(one.panel)) for one in waiting}
    rows = [
        (
            block.name,
            f"{block.limit:g}",
            str(len(block.panel.train) * len(block.panel.seeds)),
            seconds(costs[block.name].seconds) if block.name in costs else "there",
        )
        for block in atlas.blocks()
    ]
    total = total_cost(list(costs.values()))
    print(f"{plural(len(waiting), 'block')} missing: {seconds(total.seconds)} of one core.")
    print_wrapped(
        f"Atlas {atlas.name}: {atlas.argument} over its critical value {atlas.critical:.4g}.",
    )
    print_columns(("block", atlas.argument, "policies", "core time"), rows)
