"""The members of the zip, read only if they are there and not too large."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import BinaryIO

from ..error import DAMAGED, PolicyFileError
from . import limits


def read_members(file: Path | BinaryIO) -> tuple[bytes, bytes]:
    """The bytes of `data` and `policy.pth`, checked for presence and size."""
    try:
        with zipfile.ZipFile(file) as archive:
            return (
                _read_member(archive, "data", limits.MAX_JSON_BYTES),
                _read_member(archive, "policy.pth", limits.MAX_WEIGHTS_BYTES),
            )
    except PolicyFileError:
        raise
    except zipfile.BadZipFile as error:
        raise PolicyFileError(f"is not a complete zip file; {DAMAGED}, or copy it again") from error
    except OSError as error:
        raise PolicyFileError(
            f"cannot be opened ({error.strerror or error}); check the path"
        ) from error
    except Exception as error:  # a damaged archive can fail in any way inside zipfile and zlib
        raise PolicyFileError(f"cannot be unpacked ({type(error).__name__}); {DAMAGED}") from error


def _read_member(archive: zipfile.ZipFile, name: str, limit: int) -> bytes:
    """One member, refused above `limit` bytes before anything is unpacked."""
    try:
        info = archive.getinfo(name)
    except KeyError:
        raise PolicyFileError(
            f"has no member '{name}', so it is not a model saved by stable-baselines3; "
            "give the .zip that model.save(path) wrote"
        ) from None
    if info.file_size > limit:
        raise PolicyFileError(
            f"has a member '{name}' of {info.file_size} bytes, above the limit of {limit}; "
            "give a model with a smaller network"
        )
    return archive.read(info)
