"""Films: the episodes are those of the environments, the ledger closes, the picture tells it."""

from __future__ import annotations

import subprocess

import gymnasium as gym
import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

import integ_gym
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.envs.rendering.canvas import FAILS, GREEN
from integ_gym.envs.settings import Discretization
from integ_gym.eval.film import HOLD, Film, parse_discretization, write_film
from integ_gym.train.baselines import make_baseline

PENDULUM = "IntegPendulum-v0"
HOME = Discretization("rk4", 0.05, 0.05)
SHORT = {"duration": 0.5}


def zero(env_id: str):
    return make_baseline("zero", environment_setup(env_id, {}))


def film_of(*names: str, env_id: str = PENDULUM, **environment) -> Film:
    return integ_gym.side_by_side(
        zero(env_id), names, 3, env_id=env_id, environment={**SHORT, **environment}
    )


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_the_ledger_of_every_environment_closes(env_id):
    film = film_of("explicit_euler", "truth", env_id=env_id, damping=0.1)
    for episode in film.episodes:
        *parts, energy = episode.ledger().values()
        np.testing.assert_allclose(sum(parts), energy, atol=1e-9)
        assert np.abs(episode.losses).max() > 0.0
    assert film[len(film) - 1].dtype == np.uint8


def test_all_episodes_start_alike_and_are_those_of_the_environment():
    film = film_of("explicit_euler", "rk4 dt=0.025", "mujoco RK4", control_period=0.05)
    first = film.episodes[0].states[0]
    for episode in film.episodes:
        np.testing.assert_array_equal(episode.states[0], first)
        cell = episode.discretization
        env = gym.make(PENDULUM, **SHORT, **cell.arguments())
        env.reset(seed=3)
        for place in range(1, len(episode.times)):
            *_, info = env.step([0.0])
            assert info["energy"] == pytest.approx(episode.energy[place], abs=1e-12)
        np.testing.assert_array_equal(env.unwrapped.state, episode.states[-1])
        assert episode.success == info["success"] == film.success[cell.name]


def test_a_film_lasts_as_long_as_its_longest_episode():
    film = film_of("rk4", env_id="IntegCartPole-v0", duration=10.0)
    assert film.seconds == film.episodes[0].times[-1] < 10.0  # it falls
    assert len(film) == len(list(film)) == int(film.seconds * film.fps + 1e-6) + 1
    np.testing.assert_array_equal(film[-1], film[len(film) - 1])
    assert len(film[:3]) == 3
    np.testing.assert_array_equal(film[0], film[0])
    assert (film[0] != film[-1]).any()
    with pytest.raises(IndexError, match="there is no frame"):
        film[len(film)]


def test_the_verdict_is_in_the_picture():
    """Balance for a tenth of a second succeeds; a swing-up without control fails."""
    succeeding = film_of("rk4", env_id="IntegCartPole-v0", duration=0.1, dt=0.02)[0][74:130]
    failing = film_of("rk4", start="hanging")[0][74:130]
    for frame, present, absent in ((succeeding, GREEN, FAILS), (failing, FAILS, GREEN)):
        assert (np.abs(frame.astype(int) - present).max(axis=2) < 6).sum() > 20
        assert not (np.abs(frame.astype(int) - absent).max(axis=2) < 6).any()


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ("explicit_euler", Discretization("explicit_euler", 0.05, 0.05)),
        ("rk4 dt=0.0125", Discretization("rk4", 0.0125, 0.05)),
        ("mujoco RK4 dt=0.01", Discretization("RK4", 0.01, 0.05, "mujoco")),
        ("truth", Discretization("reference", 0.05, 0.05)),
        ("reference dt=0.01", Discretization("reference", 0.05, 0.05)),
        ({"integrator": "rk4", "dt": 0.01}, Discretization("rk4", 0.01, 0.05)),
        (HOME, HOME),
    ],
)
def test_discretizations_are_named_as_in_panels(asked, expected):
    assert parse_discretization(asked, HOME, PENDULUM) == expected
    assert parse_discretization(expected.name, HOME, PENDULUM) == expected


@pytest.mark.parametrize("asked", ["", "dt=0.1", "a b c", "rk4 dt=fast", {"dt": 0.1}, {"step": 1}])
def test_what_is_no_discretization_is_refused(asked):
    with pytest.raises(ValueError, match=r"discretization is|must be a number"):
        parse_discretization(asked, HOME, PENDULUM)


@pytest.mark.parametrize(
    ("integrator", "env_id", "told"),
    [
        ("rk4", None, "give env_id as well"),
        ("rk4", "Hopper-v5", "films show IntegAcrobot-v0"),
        ("no_such", PENDULUM, "unknown integrator"),
    ],
)
def test_what_cannot_be_filmed_is_refused(integrator, env_id, told):
    with pytest.raises(ValueError, match=told):
        integ_gym.side_by_side(zero(PENDULUM), [integrator], 0, env_id=env_id)


@pytest.fixture
def frames():
    """A square that moves over a white ground, of odd size."""
    drawn = np.full((7, 61, 91, 3), 255, dtype=np.uint8)
    for k, frame in enumerate(drawn):
        frame[20:40, 10 * k : 10 * k + 20] = (0, 114, 178)
    return list(drawn)


def test_a_gif_has_every_frame_and_its_time(frames, tmp_path):
    path = write_film(frames, 20, tmp_path / "film.gif")
    with Image.open(path) as film:
        assert film.n_frames == len(frames)
        assert film.info["loop"] == 0
        for k, frame in enumerate(frames):
            film.seek(k)
            assert film.info["duration"] == (1000 * HOLD if k == len(frames) - 1 else 50)
            assert np.abs(np.asarray(film.convert("RGB")).astype(int) - frame).max() < 12
    assert [entry.name for entry in tmp_path.iterdir()] == ["film.gif"]


def test_an_mp4_has_every_frame_and_holds_the_last(frames, tmp_path):
    path = write_film(frames, 20, tmp_path / "film.MP4")
    program = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path)]
    read = subprocess.run(
        [*program, *["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]], capture_output=True, check=True
    )
    about = read.stderr.decode()
    assert " 90x60" in about
    assert " 20 fps" in about
    shown = np.frombuffer(read.stdout, np.uint8).reshape(-1, 60, 90, 3)
    assert len(shown) == len(frames) + HOLD * 20
    for k in range(len(frames)):
        blue = np.flatnonzero(shown[k, 30, :, 0] < 128)
        assert abs(blue.mean() - (10 * k + 9.5)) < 2.0


class Broken(list):
    """Frames, the fourth of which cannot be drawn."""

    def __iter__(self):
        yield from self[:3]
        raise ValueError("broken")


def test_a_film_that_fails_leaves_what_was_there(frames, tmp_path):
    path = tmp_path / "film.gif"
    path.write_bytes(b"before")
    with pytest.raises(ValueError, match="broken"):
        write_film(Broken(frames), 20, path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["film.gif"]
    assert path.read_bytes() == b"before"
