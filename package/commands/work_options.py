"""Options of commands that give their work to several processes, or to an engine's."""

from __future__ import annotations

import argparse
from pathlib import Path

from integ_gym.support.errors import InputError
from integ_gym.support.executors import EXECUTORS, Resources
from integ_gym.support.options import whole_number


def add_work(parser: argparse.ArgumentParser, default: str = "default: one per core") -> None:
    """Add to a command's options how many processes work, and whether a bar is shown.

    Args:
        parser: of the command.
        default: what happens without ``--workers``, or at a number, in words.
    """
    parser.add_argument("--workers", type=whole_number, metavar="N", help=f"processes; {default}")
    add_progress(parser)


def add_progress(parser: argparse.ArgumentParser) -> None:
    """Add to a command's options whether a bar is shown."""
    parser.add_argument("--no-progress", action="store_true", help="show no progress bar")


def workers_of(arguments: argparse.Namespace) -> int | None:
    """How many processes are asked for; None: as many as the command thinks good.

    Raises:
        ValueError: for none.
    """
    count: int | None = arguments.workers
    if count is not None and count < 1:
        raise InputError(f"--workers must be 1 or above, got {count}")
    return count


def add_engine(parser: argparse.ArgumentParser) -> None:
    """Add the options to a command's."""
    add = parser.add_argument_group("executor (docs/how-to/clusters.md)").add_argument
    add(
        "--executor", default="local", metavar="NAME",
        help=f"what runs the processes: {', '.join(EXECUTORS)}, or module:function for a function "
        "of your own that returns a concurrent.futures.Executor (default: local)",
    )  # fmt: skip
    add(
        "--address", metavar="ADDRESS",
        help="a running cluster of Ray or Dask (default: one is started on this machine); with "
        "slurm, local runs its jobs on this machine",
    )  # fmt: skip
    add(
        "--cores-per-worker", type=whole_number, default=1, metavar="N",
        help="cores that the executor sets aside for each process (default: 1)",
    )  # fmt: skip
    add(
        "--gpus-per-worker", type=float, default=0.0, metavar="N",
        help="the same for GPUs, on which the fleet then trains (default: 0)",
    )  # fmt: skip


def resources_of(arguments: argparse.Namespace) -> Resources:
    """What the options ask for, of each worker."""
    return Resources(cores=arguments.cores_per_worker, gpus=arguments.gpus_per_worker)


def page_location(out: str | Path) -> str:
    """Where a run's page is."""
    return str((out / "report.html").resolve()) if isinstance(out, Path) else f"{out}/report.html"
