"""An atlas's blocks, run one after the other; what has a summary is not run again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import msgspec

from integ_gym.support.errors import InputError

from ..panel.run import run_panel
from . import summaries
from .specification import Atlas, Block


def summary_path(folder: Path, block: Block) -> Path:
    """Where the summary of a block lies."""
    return folder / f"{block.name}.parquet"


def finished(atlas: Atlas, folder: Path) -> list[tuple[Block, summaries.Summary]]:
    """Blocks that have a summary, with it.

    Args:
        atlas: what is run.
        folder: of the summaries.

    Raises:
        ValueError: if a summary is of another specification.
    """
    found = []
    for block in atlas.blocks():
        path = summary_path(folder, block)
        if not path.exists():
            continue
        summary = summaries.read_summary(path)
        if summary.origin.specification != msgspec.to_builtins(block.panel.to_json()):
            raise InputError(
                f"{path} is of another specification than block {block.name}; give another folder "
                "with --summaries, or remove it to run the block again"
            )
        found.append((block, summary))
    return found


def missing(atlas: Atlas, folder: Path) -> list[Block]:
    """Blocks that have no summary; see :func:`finished`."""
    there = {block.name for block, _ in finished(atlas, folder)}
    return [block for block in atlas.blocks() if block.name not in there]


def run_blocks(
    atlas: Atlas,
    blocks: Sequence[Block],
    out: Path,
    folder: Path,
    *,
    workers: int | None = None,
    progress: bool = True,
) -> Iterator[tuple[Block, summaries.Summary]]:
    """Run blocks, each to its page and its summary, as they are asked for.

    Args:
        atlas: what is run.
        blocks: some of its blocks.
        out: directory of the runs, one for each block; what was begun is finished.
        folder: of the summaries.
        workers: processes; by default one per core.
        progress: show bars on stderr.

    Raises:
        SpecError, RunDirectoryError, PanelError, TrainingError: see :func:`run_panel`.
    """
    for block in blocks:
        run = out / block.name
        run_panel(block.panel, run, workers=workers, progress=progress, command="integ-gym atlas")
        summary = summaries.summarize(run, atlas.name, block)
        summaries.write_summary(summary, summary_path(folder, block))
        yield block, summary


def again(
    atlas: Atlas, block: Block, out: Path, folder: Path, *, workers: int | None = None
) -> summaries.Agreement:
    """Run a finished block anew, and note that its outcomes are the same.

    Its first two seeds tell, where they come out the same or the processor is the same: a policy
    that is trained alone may round otherwise than beside others. Otherwise the whole block is run,
    and agrees or not by :func:`compare`.

    Args:
        atlas: what is run.
        block: one of its blocks.
        out: directory for the run; what an earlier version left there is refused.
        folder: of the summaries.
        workers: processes; by default one per core.

    Raises:
        ValueError: if the block has no summary, or its outcomes are others.
        SpecError, RunDirectoryError, PanelError, TrainingError: see :func:`run_panel`.
    """
    path = summary_path(folder, block)
    if not path.exists():
        raise InputError(f"block {block.name} has no summary in {folder}; run it first")
    before, run = summaries.read_summary(path), out / f"{block.name}-again"
    few = replace(block, panel=replace(block.panel, seeds=block.panel.seeds[:2]))
    for part in (few, block):
        run_panel(part.panel, run, workers=workers, command="integ-gym atlas --again")
        fresh = summaries.summarize(run, atlas.name, part)
        if not summaries.first_difference(before, fresh) or summaries.same_processor(before, fresh):
            break
    found = summaries.compare(block.name, before, fresh)
    summaries.note(found, folder)
    return found
