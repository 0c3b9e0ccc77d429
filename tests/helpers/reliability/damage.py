"""Every file of a run damaged in every way that chance finds."""

from __future__ import annotations

import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path

SEALED = ("*.json", "evidence/*.parquet", "policies/*/*", "units/*.json")
"""Files that decide a result."""


def files_of(run: Path) -> list[Path]:
    """The files that may be damaged, in an order that is the same everywhere."""
    return sorted(file for pattern in SEALED for file in run.glob(pattern))


def truncate(file: Path, other: Path, rng: random.Random) -> None:
    """Cut off at any byte."""
    os.truncate(file, rng.randrange(file.stat().st_size))


def flip(file: Path, other: Path, rng: random.Random) -> None:
    """Turn one bit of any byte."""
    content = bytearray(file.read_bytes())
    content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    file.write_bytes(content)


def overwrite(file: Path, other: Path, rng: random.Random) -> None:
    """Write noise over a stretch."""
    content = bytearray(file.read_bytes())
    first = rng.randrange(len(content))
    length = min(rng.randint(2, 512), len(content) - first)
    content[first : first + length] = rng.randbytes(length)
    file.write_bytes(content)


def lengthen(file: Path, other: Path, rng: random.Random) -> None:
    """Write something behind the end."""
    with file.open("ab") as end:
        end.write(rng.randbytes(rng.randint(1, 512)))


def delete(file: Path, other: Path, rng: random.Random) -> None:
    """Remove it."""
    file.unlink()


def empty(file: Path, other: Path, rng: random.Random) -> None:
    """Leave nothing in it."""
    file.write_bytes(b"")


def swap(file: Path, other: Path, rng: random.Random) -> None:
    """Change places with another file of its kind."""
    run = next(folder for folder in file.parents if (folder / "evidence").is_dir())
    alike = [x for x in files_of(run) if x.suffix == file.suffix and x != file]
    partner = rng.choice([x for x in alike if x.read_bytes() != file.read_bytes()])
    held = file.read_bytes()
    file.write_bytes(partner.read_bytes())
    partner.write_bytes(held)


def replace(file: Path, other: Path, rng: random.Random) -> None:
    """Put a file of its kind out of another run of the same panel there."""
    alike = [x for x in files_of(other) if x.suffix == file.suffix]
    same = [x for x in alike if x.name == file.name] or alike
    shutil.copyfile(rng.choice(same), file)


def block(file: Path, other: Path, rng: random.Random) -> None:
    """Put a pipe there from which nothing ever comes."""
    file.unlink()
    os.mkfifo(file)


DAMAGES: dict[str, Callable[[Path, Path, random.Random], None]] = {
    "cut off": truncate,
    "one bit flipped": flip,
    "overwritten with noise": overwrite,
    "lengthened": lengthen,
    "deleted": delete,
    "emptied": empty,
    "swapped with another": swap,
    "replaced by another run's": replace,
    "replaced by a pipe": block,
}
