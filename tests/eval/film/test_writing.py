"""What is written is what was drawn, whole or not at all."""

from __future__ import annotations

import re
import subprocess

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from integ_gym.eval.film import HOLD, write_film

FPS = 20


@pytest.fixture
def frames():
    """A square that moves over a white ground, of odd size."""
    made = np.full((7, 61, 91, 3), 255, dtype=np.uint8)
    for k, frame in enumerate(made):
        frame[20:40, 10 * k : 10 * k + 20] = (0, 114, 178)
    return list(made)


def test_a_gif_has_every_frame_and_its_time(frames, tmp_path):
    path = write_film(frames, FPS, tmp_path / "film.gif")
    with Image.open(path) as film:
        assert film.n_frames == len(frames)
        assert film.info["loop"] == 0
        for k, frame in enumerate(frames):
            film.seek(k)
            assert film.info["duration"] == (1000 * HOLD if k == len(frames) - 1 else 50)
            assert np.abs(np.asarray(film.convert("RGB")).astype(int) - frame).max() < 12
    assert [entry.name for entry in tmp_path.iterdir()] == ["film.gif"]


def test_an_mp4_has_every_frame_and_holds_the_last(frames, tmp_path):
    path = write_film(frames, FPS, tmp_path / "film.MP4")
    program = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path)]
    read = subprocess.run(
        [*program, *["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]], capture_output=True, check=True
    )
    about = read.stderr.decode()
    assert " 90x60" in about
    assert f" {FPS} fps" in about
    shown = np.frombuffer(read.stdout, np.uint8).reshape(-1, 60, 90, 3)
    assert len(shown) == len(frames) + HOLD * FPS
    for k in range(len(frames)):
        blue = np.flatnonzero(shown[k, 30, :, 0] < 128)
        assert abs(blue.mean() - (10 * k + 9.5)) < 2.0


def test_other_endings_and_absent_folders_are_refused_before_anything_is_drawn(tmp_path):
    with pytest.raises(ValueError, match=re.escape("written as .gif or .mp4, got 'film.avi'")):
        write_film([], FPS, tmp_path / "film.avi")
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        write_film([], FPS, tmp_path / "absent" / "film.gif")


def test_a_film_that_fails_leaves_what_was_there(frames, tmp_path):
    path = tmp_path / "film.gif"
    path.write_bytes(b"before")
    with pytest.raises(ValueError, match="broken"):
        write_film(Broken(frames), FPS, path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["film.gif"]
    assert path.read_bytes() == b"before"


class Broken(list):
    """Frames, the fourth of which cannot be drawn."""

    def __iter__(self):
        yield from self[:3]
        raise ValueError("broken")
