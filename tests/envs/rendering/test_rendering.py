"""Pictures: what they show, that they repeat exactly, and that a window keeps real time."""

import math
import sys

import gymnasium as gym
import numpy as np
import pygame
import pytest

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.plants.interface import controls_of
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.envs.rendering import renderer as rendering
from integ_gym.envs.rendering.canvas import BLUE, VERMILION
from integ_gym.envs.rendering.plants import DRAWINGS
from integ_gym.envs.rendering.renderer import Renderer

PENDULUM, CART_POLE, ELASTIC = "IntegPendulum-v0", "IntegCartPole-v0", "IntegElasticPendulum-v0"
SQUARE = (PENDULUM, "IntegAcrobot-v0", "IntegAcrobotSwingUp-v0", "IntegReacher-v0")
QUADROTOR, HOPPER = "IntegQuadrotor-v0", "IntegHopper-v0"


def _draw(env_id, state, control=0.0, **arguments):
    setup = environment_setup(env_id, arguments)
    renderer = Renderer(setup, "rgb_array", 20)
    return renderer.draw(np.array(state), controls_of(setup.plant, control), 0.0)


def _is_colour(frame, colour):
    """Pixels close to a colour, shape (height, width)."""
    return np.abs(frame.astype(int) - colour).max(axis=2) <= 6


def _centroid(frame, colour=BLUE):
    """Mean (x, y) of the pixels of a colour."""
    rows, columns = np.nonzero(_is_colour(frame, colour))
    assert rows.size > 30, "colour not found"
    return float(columns.mean()), float(rows.mean())


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_frames_before_and_after_steps(env_id):
    env = gym.make(env_id, render_mode="rgb_array")
    env.reset(seed=3)
    frames = [env.render()]
    for _ in range(3):
        env.step(env.action_space.sample())
        frames.append(env.render())
    env.close()
    for frame in frames:
        assert frame.shape == ((500, 500, 3) if env_id in SQUARE else (400, 600, 3))
        assert frame.dtype == np.uint8
        assert frame.flags.c_contiguous
        assert frame.flags.writeable
        assert frame.flags.owndata
    assert not np.array_equal(frames[0], frames[-1])


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_pictures_repeat_exactly_whatever_was_drawn_before(env_id, monkeypatch):
    """Without the display, and beside the pictures of others."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "no such driver")
    before, setup = pygame.display.get_init(), environment_setup(env_id, {})
    state = np.array((0.3, 0.1) * len(setup.plant.coordinates))
    used, other = (Renderer(setup, "rgb_array", 20) for _ in range(2))
    pushed = controls_of(setup.plant, 1.0)
    used.draw(-state, controls_of(setup.plant, -1.0), 2.0)
    first = other.draw(state, pushed, 0.5)
    other.close()
    np.testing.assert_array_equal(first, used.draw(state, pushed, 0.5))
    assert pygame.display.get_init() == before
    assert used.draw(np.full(len(state), -3e38), pushed, 0.0).shape == first.shape


@pytest.mark.parametrize("mass_distribution", ["uniform", "point"])
def test_pendulum_points_along_its_angle(mass_distribution):
    for theta in (0.0, math.pi, math.pi / 2, -2.5, 9.0):
        x, y = _centroid(_draw(PENDULUM, (theta, 0.0), mass_distribution=mass_distribution))
        assert math.hypot(x - 250.0, 250.0 - y) > 60.0
        counter_clockwise = math.atan2(250.0 - x, 250.0 - y)
        assert abs(math.remainder(counter_clockwise - theta, 2.0 * math.pi)) < 0.02


def test_torque_of_the_other_sign_mirrors_the_arrow():
    left, right = (_is_colour(_draw(PENDULUM, (0.0, 0.0), u), VERMILION) for u in (1.5, -1.5))
    assert left.sum() > 300
    assert (left != right[:, ::-1]).sum() < 0.03 * left.sum()
    assert (left != right).sum() > 0.5 * left.sum()


@pytest.mark.parametrize(("x", "theta"), [(-2.0, 0.2), (0.0, -0.2), (1.5, 1.0), (0.0, -2.0)])
def test_pole_leans_to_the_right_for_a_positive_angle(x, theta):
    pole_x, pole_y = _centroid(_draw(CART_POLE, (x, 0.0, theta, 0.0)))
    lean = math.atan2(pole_x - (300.0 + 230.0 / 2.4 * x), 238.0 - pole_y)
    assert lean == pytest.approx(theta, abs=0.05)


def test_bob_is_where_it_is():
    scale = 210.0 / environment_setup(ELASTIC, {}).plant.hanging_length
    for x, y in ((0.0, 0.0), (0.6, 0.1), (-0.4, 0.5)):
        bob = _centroid(_draw(ELASTIC, (x, 0.0, y, 0.0)))
        assert bob == pytest.approx((300.0 + scale * x, 300.0 - scale * y), abs=1.0)


@pytest.mark.parametrize("theta", [0.0, 0.5, -2.0])
def test_quadrotor_is_where_it_is_and_thrusts_along_its_axis(theta):
    frame = _draw(QUADROTOR, (1.0, 0.0, 0.5, 0.0, theta, 0.0, 0.0, 0.0, 0.0, 0.0), 4.0)
    (x, y), (arrow_x, arrow_y) = (_centroid(frame, colour) for colour in (BLUE, VERMILION))
    assert math.hypot(x - 362.0, y - 169.0) < 8.0
    assert math.atan2(arrow_x - 362.0, 169.0 - arrow_y) == pytest.approx(theta, abs=0.05)


@pytest.mark.parametrize(("theta", "hip"), [(0.0, 0.0), (0.3, -0.2), (-0.4, 0.3)])
def test_the_hoppers_torso_and_force_are_where_they_are(theta, hip):
    """The hip 130 pixels above the ground; a force on the foot leaves it along the leg."""
    state = (7.3, 0.0, 0.5, 0.0, theta, 0.0, hip, 0.0, 0.4, 0.0)
    frame = Renderer(environment_setup(HOPPER, {}), "rgb_array", 20).draw(
        np.array(state), (0.0, 150.0), 0.0
    )
    (x, y), (arrow_x, arrow_y) = (_centroid(frame, colour) for colour in (BLUE, VERMILION))
    assert math.atan2(x - 300.0, 190.0 - y) == pytest.approx(theta, abs=0.1)
    assert math.atan2(arrow_x - 300.0, arrow_y - 190.0) == pytest.approx(hip - theta, abs=0.05)


@pytest.mark.parametrize(("theta_1", "theta_2"), [(0.0, 0.0), (0.5, 0.4), (2.0, -1.0)])
def test_the_acrobots_second_link_is_where_it_is(theta_1, theta_2):
    """Hanging at zero, counter-clockwise positive; its middle half a metre beyond the elbow."""
    x, y = _centroid(_draw("IntegAcrobot-v0", (theta_1, 0.0, theta_2, 0.0)), BLUE)
    across = math.sin(theta_1) + 0.5 * math.sin(theta_1 + theta_2)
    down = math.cos(theta_1) + 0.5 * math.cos(theta_1 + theta_2)
    assert (x, y) == pytest.approx((250.0 + 100.0 * across, 250.0 + 100.0 * down), abs=5.0)


@pytest.mark.parametrize("theta", [0.5, -2.0])
def test_a_servos_target_is_drawn_where_it_is(theta):
    """Not as the torque that the same number of newton metres would be."""
    x, y = _centroid(_draw(PENDULUM, (3.0, 0.0), theta, actuator="position"), VERMILION)
    assert math.atan2(250.0 - x, 250.0 - y) == pytest.approx(theta, abs=0.05)
    x, _ = _centroid(_draw(ELASTIC, (0.0,) * 4, 0.3 * theta, actuator="position"), VERMILION)
    setup = environment_setup(ELASTIC, {})
    assert x == pytest.approx(300.0 + 210.0 / setup.plant.hanging_length * 0.3 * theta, abs=1.0)


def test_unknown_plant_gets_its_state_in_words(monkeypatch):
    monkeypatch.delitem(DRAWINGS, "cart_pole")
    one, other = (_draw(CART_POLE, (x, 0.0, 0.0, 0.0)) for x in (0.1, 0.2))
    assert (one != other).any()
    assert not _is_colour(one, BLUE).any()


def test_vector_environment_gives_one_frame_per_lane():
    envs = gym.make_vec(
        CART_POLE, num_envs=3, render_mode="rgb_array", length=np.array([0.3, 0.5, 0.7])
    )
    envs.reset(options={"state": np.array([[x, 0.0, 0.0, 0.0] for x in (-1.0, 0.0, 1.0)])})
    positions = [_centroid(frame)[0] for frame in envs.render()]
    envs.close()
    assert positions == pytest.approx([300.0 - 230.0 / 2.4, 300.0, 300.0 + 230.0 / 2.4], abs=2.0)


@pytest.mark.parametrize("mode", ["rgb_array", "human"])
def test_missing_pygame_names_the_remedy(mode, monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(ModuleNotFoundError, match=r'pip install -e "\.\[render\]"$'):
        Renderer(environment_setup(PENDULUM, {}), mode, 20)


class Clock:
    """A clock that passes only while somebody sleeps."""

    now = 100.0

    def sleep(self, seconds):
        assert seconds >= 0.0
        self.now += seconds


@pytest.fixture
def clock(monkeypatch):
    """Of windows that nobody sees."""
    clock = Clock()
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(rendering, "perf_counter", lambda: clock.now)
    monkeypatch.setattr(rendering, "sleep", clock.sleep)
    yield clock
    pygame.display.quit()


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_window_opens_and_closes(env_id, clock):
    env = gym.make(env_id, render_mode="human")
    env.reset(seed=1)
    for _ in range(3):
        env.step(env.action_space.sample())
    assert env.render() is None
    size = (500, 500) if env_id in SQUARE else (600, 400)
    assert pygame.display.get_surface().get_size() == size
    env.close()
    assert not pygame.display.get_init()
    env.close()


@pytest.mark.parametrize("period", [0.001, 0.02, 0.5])
def test_window_keeps_real_time(period, clock, monkeypatch):
    flips = []
    monkeypatch.setattr(pygame.display, "flip", lambda: flips.append(clock.now))
    setup = environment_setup(PENDULUM, {"dt": period})
    renderer = Renderer(setup, "human", round(1.0 / period))
    count = round(2.0 / period)
    for step in range(count + 1):
        renderer.draw(np.array([0.0, 0.0]), (0.0,), step * period)
    renderer.close()
    assert clock.now - 100.0 == pytest.approx(2.0, abs=0.02)
    assert min(count, 2 * 60) / 2 < len(flips) <= min(count, 2 * 60) + 1
    assert np.diff(flips).min() == pytest.approx(max(period, 1 / 60), rel=0.25)
