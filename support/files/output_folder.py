"""The folder of ``--out``."""

from __future__ import annotations

import errno
import os
from pathlib import Path


def make_folder(out: Path) -> Path:
    """``out`` as a folder that can be written to, made where there is none.

    Raises:
        ValueError: where it cannot be, with the remedy.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        if not os.access(out, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise cannot_write(out, error) from None
    return out


def cannot_write(out: Path, error: OSError) -> ValueError:
    """What to raise where writing under ``out`` failed."""
    return ValueError(f"cannot write to {out}: {error.strerror or error}; give another --out")
