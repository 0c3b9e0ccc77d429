"""Frames written as a GIF or as MP4."""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.support.optional import load, require

Frame = npt.NDArray[np.uint8]

FORMATS = (".gif", ".mp4")
HOLD = 2.5
"""How long the last frame stays, s."""
_COLOURS = 64
_RATE_FACTOR = 20
"""Of H.264: 0 loses nothing, 51 most."""
_SAMPLES = 5
"""Frames that the palette of a GIF is made from."""


def check_writable(path: Path) -> None:
    """Refuse what a film cannot be written to, before anything is run.

    Raises:
        ValueError: for another ending than a film's.
        OSError: if its folder is not there, or it is one itself.
        ModuleNotFoundError: if the extra is missing, with the command that installs it.
    """
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"a film is written as {' or '.join(FORMATS)}, got {path.name!r}")
    require("render")
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; give another path for the film")
    if not path.resolve().parent.is_dir():
        raise FileNotFoundError(
            f"there is no folder {path.parent}; make it, or give another path for the film"
        )


def write_film(frames: Sequence[Frame], fps: int, path: Path) -> Path:
    """Write frames, the last of which stays for a while; the file is replaced in one step.

    Args:
        frames: each of shape (height, width, 3).
        fps: frames per second.
        path: ends in ``.gif`` or ``.mp4``.

    Raises:
        ValueError, OSError, ModuleNotFoundError: see :func:`check_writable`.
    """
    check_writable(path)
    part = path.with_name(f".{path.stem}.part{path.suffix.lower()}")
    try:
        {".gif": _write_gif, ".mp4": _write_mp4}[part.suffix](frames, fps, part)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    return path


def _write_gif(frames: Sequence[Frame], fps: int, path: Path) -> None:
    """With one palette for all frames, so that what stands still costs nothing."""
    images = load("PIL.Image", "render")
    places = np.linspace(0, len(frames) - 1, min(_SAMPLES, len(frames))).round().astype(int)
    sample = images.fromarray(np.concatenate([frames[int(k)] for k in places]))
    palette = sample.quantize(_COLOURS, dither=images.Dither.NONE)
    drawn: Iterator[Any] = (
        images.fromarray(frame).quantize(palette=palette, dither=images.Dither.NONE)
        for frame in frames
    )
    times = [round(1000 / fps)] * (len(frames) - 1) + [round(1000 * HOLD)]
    next(drawn).save(path, save_all=True, append_images=drawn, duration=times, loop=0)


def _write_mp4(frames: Sequence[Frame], fps: int, path: Path) -> None:
    """H.264 with pixels that every player shows, which takes even sizes."""
    height, width = (n - n % 2 for n in frames[0].shape[:2])
    given = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {fps} -i -".split()
    made = f"-c:v libx264 -pix_fmt yuv420p -crf {_RATE_FACTOR}".split()
    program = load("imageio_ffmpeg", "render").get_ffmpeg_exe()
    command = [program, "-loglevel", "error", "-y", *given, *made, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        told = _fed(process, (f[:height, :width] for f in _held(frames, round(HOLD * fps))))
    if process.returncode:
        raise OSError(f"cannot write {path.name}: {told.strip() or 'ffmpeg failed'}")


def _fed(process: subprocess.Popen[bytes], frames: Iterable[Frame]) -> str:
    """What ffmpeg says while it is given frames."""
    assert process.stdin is not None
    assert process.stderr is not None
    with contextlib.suppress(BrokenPipeError):
        for frame in frames:
            process.stdin.write(frame.tobytes())
        process.stdin.close()
    return process.stderr.read().decode(errors="replace")


def _held(frames: Iterable[Frame], count: int) -> Iterator[Frame]:
    """Frames, the last of them repeated."""
    for frame in frames:
        yield frame
    for _ in range(count):
        yield frame
