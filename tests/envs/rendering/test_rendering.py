"""Pictures: what they show, that they repeat exactly, and that a window keeps real time."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import pygame
import pytest

from integ_gym.envs.rendering import renderer as rendering
from integ_gym.envs.rendering.canvas import BLUE, VERMILION, Colour
from integ_gym.envs.rendering.plants import DRAWINGS
from integ_gym.envs.rendering.renderer import Renderer
from integ_gym.envs.settings import Setup

Frame = npt.NDArray[np.uint8]

IDS = {
    "IntegPendulum-v0": (500, 500, 3),
    "IntegCartPole-v0": (400, 600, 3),
    "IntegCartPoleSwingUp-v0": (400, 600, 3),
    "IntegElasticPendulum-v0": (400, 600, 3),
}
PENDULUM, CART_POLE, SWING_UP, ELASTIC = IDS
HINGE = (250.0, 250.0)
LABEL_ROWS = slice(0, 40)
SCENE_ROWS = slice(40, 460)


def make_setup(env_id: str, **arguments: Any) -> Setup:
    env = gym.make(env_id, **arguments)
    setup: Setup = env.unwrapped.setup  # type: ignore[attr-defined]
    env.close()
    return setup


def draw(setup: Setup, state: tuple[float, ...], control: float = 0.0, time: float = 0.0) -> Frame:
    frame = Renderer(setup, "rgb_array", 20).draw(np.array(state), control, time)
    assert frame is not None
    return frame


def is_colour(frame: Frame, colour: Colour) -> npt.NDArray[np.bool_]:
    """Pixels close to a colour, shape (height, width)."""
    return np.abs(frame.astype(int) - colour).max(axis=2) <= 6  # type: ignore[no-any-return]


def centroid(frame: Frame, colour: Colour) -> tuple[float, float]:
    """Mean (x, y) of the pixels of a colour."""
    rows, columns = np.nonzero(is_colour(frame, colour))
    assert rows.size > 30, "colour not found"
    return float(columns.mean()), float(rows.mean())


@pytest.fixture
def dummy_display(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    yield
    pygame.display.quit()


class Clock:
    """A clock that passes only while somebody sleeps."""

    def __init__(self) -> None:
        self.now = 100.0

    def read(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0.0
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(rendering, "perf_counter", clock.read)
    monkeypatch.setattr(rendering, "sleep", clock.sleep)
    return clock


@pytest.mark.parametrize("env_id", IDS)
def test_frames_before_and_after_steps(env_id: str) -> None:
    env = gym.make(env_id, render_mode="rgb_array")
    env.reset(seed=3)
    frames: list[Any] = [env.render()]
    for _ in range(5):
        env.step(env.action_space.sample())
        frames.append(env.render())
    env.close()
    for frame in frames:
        assert isinstance(frame, np.ndarray)
        assert frame.shape == IDS[env_id]
        assert frame.dtype == np.uint8
        assert frame.flags.c_contiguous
        assert frame.flags.writeable
        assert frame.flags.owndata
    assert not np.array_equal(frames[0], frames[-1])


@pytest.mark.parametrize(
    ("env_id", "state"),
    [
        (PENDULUM, (0.7, 2.0)),
        (CART_POLE, (0.3, 0.1, 0.1, 1.0)),
        (SWING_UP, (2.4, 0.1, 3.0, 1.0)),
        (ELASTIC, (0.3, 0.1, 0.1, 1.0)),
    ],
)
def test_pictures_repeat_exactly(env_id: str, state: tuple[float, ...]) -> None:
    setup = make_setup(env_id)
    first = draw(setup, state, 1.0, 0.5)
    used = Renderer(setup, "rgb_array", 20)
    used.draw(-np.array(state), -1.0, 2.0)
    np.testing.assert_array_equal(first, draw(setup, state, 1.0, 0.5))
    np.testing.assert_array_equal(first, used.draw(np.array(state), 1.0, 0.5))


def test_off_screen_drawing_leaves_the_display_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "no such driver")
    before = pygame.display.get_init()
    draw(make_setup(PENDULUM), (0.1, 0.0))
    assert pygame.display.get_init() == before


@pytest.mark.parametrize("mass_distribution", ["uniform", "point"])
@pytest.mark.parametrize("theta", [0.0, math.pi, math.pi / 2, -math.pi / 2, 0.6, -2.5, 9.0])
def test_pendulum_points_along_its_angle(theta: float, mass_distribution: str) -> None:
    frame = draw(make_setup(PENDULUM, mass_distribution=mass_distribution), (theta, 0.0))
    x, y = centroid(frame, BLUE)
    across, up = x - HINGE[0], HINGE[1] - y
    assert math.hypot(across, up) > 60.0
    counter_clockwise = math.atan2(-across, up)
    assert math.remainder(counter_clockwise - theta, 2.0 * math.pi) == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("theta", [0.0, math.pi])
def test_torque_of_the_other_sign_mirrors_the_arrow(theta: float) -> None:
    setup = make_setup(PENDULUM)
    left, right = (
        is_colour(draw(setup, (theta, 0.0), torque), VERMILION) for torque in (1.5, -1.5)
    )
    assert left.sum() > 300
    assert (left != right[:, ::-1]).sum() < 0.03 * left.sum()
    assert (left != right).sum() > 0.5 * left.sum()


@pytest.mark.parametrize("theta", [0.2, -0.2, 1.0, -2.0])
@pytest.mark.parametrize("x", [-2.0, 0.0, 1.5])
def test_pole_leans_to_the_right_for_a_positive_angle(x: float, theta: float) -> None:
    pole_x, pole_y = centroid(draw(make_setup(CART_POLE), (x, 0.0, theta, 0.0)), BLUE)
    hinge_x, hinge_y = 300.0 + 230.0 / 2.4 * x, 238.0
    lean = math.atan2(pole_x - hinge_x, hinge_y - pole_y)
    assert lean == pytest.approx(theta, abs=0.05)


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.6, 0.1), (-0.4, 0.5)])
def test_bob_is_where_it_is(x: float, y: float) -> None:
    setup = make_setup(ELASTIC)
    scale = 210.0 / setup.plant.hanging_length  # type: ignore[attr-defined]
    bob = centroid(draw(setup, (x, 0.0, y, 0.0)), BLUE)
    assert bob == pytest.approx((300.0 + scale * x, 300.0 - scale * y), abs=1.0)


@pytest.mark.parametrize("value", [1e30, -3e38])
def test_extreme_states_are_drawn(value: float) -> None:
    assert draw(make_setup(PENDULUM), (value, 1e3), 1.0).shape == IDS[PENDULUM]
    for env_id in (CART_POLE, SWING_UP, ELASTIC):
        assert draw(make_setup(env_id), (value, 1e3, value, 1e3), 1.0).shape == IDS[env_id]


def test_label_is_on_the_picture() -> None:
    one, other = (
        draw(make_setup(PENDULUM, integrator=name), (1.0, 0.0)) for name in ("rk4", "reference")
    )
    assert (one[LABEL_ROWS] != other[LABEL_ROWS]).any()
    np.testing.assert_array_equal(one[SCENE_ROWS], other[SCENE_ROWS])


def test_unknown_plant_gets_its_state_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(DRAWINGS, "cart_pole")
    setup = make_setup(CART_POLE)
    one, other = (draw(setup, (x, 0.0, 0.0, 0.0)) for x in (0.1, 0.2))
    assert one.shape == IDS[CART_POLE]
    assert (one != other).any()
    assert not is_colour(one, BLUE).any()


def test_renderers_do_not_disturb_each_other() -> None:
    setups = [make_setup(PENDULUM), make_setup(CART_POLE), make_setup(PENDULUM, integrator="rk4")]
    states = [np.array([1.0, 0.0]), np.array([1.0, 0.0, 0.1, 0.0]), np.array([2.0, 0.0])]
    alone = [draw(setup, tuple(state)) for setup, state in zip(setups, states, strict=True)]
    renderers = [Renderer(setup, "rgb_array", 20) for setup in setups]
    together = [r.draw(state, 0.0, 0.0) for r, state in zip(renderers, states, strict=True)]
    renderers[0].close()
    again = renderers[2].draw(states[2], 0.0, 0.0)
    for expected, frame in zip([*alone, alone[2]], [*together, again], strict=True):
        np.testing.assert_array_equal(frame, expected)


def test_vector_environment_gives_one_frame_per_lane() -> None:
    envs = gym.make_vec(
        CART_POLE, num_envs=3, render_mode="rgb_array", length=np.array([0.3, 0.5, 0.7])
    )
    envs.reset(options={"state": np.array([[x, 0.0, 0.0, 0.0] for x in (-1.0, 0.0, 1.0)])})
    frames: Any = envs.render()
    envs.close()
    assert [frame.shape for frame in frames] == [IDS[CART_POLE]] * 3
    positions = [centroid(frame, BLUE)[0] for frame in frames]
    assert positions == pytest.approx([300.0 - 230.0 / 2.4, 300.0, 300.0 + 230.0 / 2.4], abs=2.0)


@pytest.mark.parametrize("mode", ["rgb_array", "human"])
def test_missing_pygame_names_the_remedy(mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    setup = make_setup(PENDULUM)
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(ModuleNotFoundError) as caught:
        Renderer(setup, mode, 20)
    assert str(caught.value).endswith('pip install -e ".[render]"')
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("dummy_display")
@pytest.mark.parametrize("env_id", IDS)
def test_window_opens_and_closes(env_id: str, clock: Clock) -> None:
    env = gym.make(env_id, render_mode="human")
    env.reset(seed=1)
    for _ in range(3):
        env.step(env.action_space.sample())
    assert env.render() is None
    height, width, _ = IDS[env_id]
    assert pygame.display.get_surface().get_size() == (width, height)
    env.close()
    assert not pygame.display.get_init()
    env.close()


@pytest.mark.usefixtures("dummy_display")
def test_windows_share_the_screen_side_by_side(clock: Clock) -> None:
    one, other = (Renderer(make_setup(PENDULUM), "human", 20) for _ in range(2))
    one.draw(np.array([1.0, 0.0]), 0.0, 0.0)
    other.draw(np.array([2.0, 0.0]), 0.0, 0.0)
    assert pygame.display.get_surface().get_size() == (1000, 500)
    one.close()
    assert pygame.display.get_surface().get_size() == (500, 500)
    other.draw(np.array([2.0, 0.0]), 0.0, 0.1)
    other.close()
    assert not pygame.display.get_init()


@pytest.mark.usefixtures("dummy_display")
@pytest.mark.parametrize("period", [0.001, 0.01, 0.02, 0.03, 0.5])
def test_window_keeps_real_time(
    period: float, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    flips: list[float] = []
    monkeypatch.setattr(pygame.display, "flip", lambda: flips.append(clock.now))
    renderer = Renderer(make_setup(PENDULUM, dt=period), "human", round(1.0 / period))
    count = round(2.0 / period)
    for step in range(count + 1):
        renderer.draw(np.array([0.0, 0.0]), 0.0, step * period)
    renderer.close()
    assert clock.now - 100.0 == pytest.approx(2.0, abs=0.02)
    assert len(flips) <= min(count, 2 * 60) + 1
    assert len(flips) > min(count, 2 * 60) / 2
    assert np.diff(flips).min() == pytest.approx(max(period, 1 / 60), rel=0.25)
