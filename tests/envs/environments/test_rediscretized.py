"""Gymnasium's MuJoCo tasks under an integrator and timestep of one's choice."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import needs
from gymnasium.wrappers import RescaleAction
from pairing import pairs

import integ_gym
from integ_gym.envs.foreign import SequentialVectorEnv

TASKS = ("HalfCheetah-v5", "Hopper-v5", "InvertedPendulum-v5", "Swimmer-v5", "Ant-v5")


@pytest.fixture(autouse=True)
def _mujoco(tmp_path, monkeypatch):
    """In a folder of its own: MuJoCo's compiler writes a file where it has a remark on a model."""
    needs("mujoco")
    monkeypatch.chdir(tmp_path)


def _actions(env, count, size=1.0):
    rng = np.random.default_rng(1)
    low, high = env.action_space.low, env.action_space.high
    return (size * rng.uniform(low, high, (count, len(low)))).astype(np.float32)


@pytest.mark.parametrize("task", TASKS)
def test_unchanged_it_is_the_stock_task_to_the_last_bit(task):
    stock, ours = gym.make(task), integ_gym.rediscretize(gym.make(task))
    assert (stock.reset(seed=5)[0] == ours.reset(seed=5)[0]).all()
    for action in _actions(stock, 100):
        expected, got = stock.step(action), ours.step(action)
        assert (expected[0] == got[0]).all()
        assert expected[1:4] == got[1:4]
        assert expected[4].items() <= got[4].items()
        if expected[2] or expected[3]:
            break


@pytest.mark.parametrize(
    ("task", "integrator"), pairs(TASKS, ("Euler", "implicitfast", "RK4"), strength=1)
)
def test_the_control_period_and_the_rewards_scale_stay(task, integrator):
    stock = gym.make(task)
    step = stock.unwrapped.model.opt.timestep
    ours = integ_gym.rediscretize(gym.make(task), integrator=integrator, dt=step / 2.0)
    assert ours.unwrapped.dt == pytest.approx(stock.unwrapped.dt, rel=1e-12)
    assert ours.unwrapped.frame_skip == 2 * stock.unwrapped.frame_skip
    stock.reset(seed=0)
    ours.reset(seed=0)
    action = np.zeros(stock.action_space.shape, np.float32)
    expected, got = stock.step(action), ours.step(action)
    assert got[1] == pytest.approx(expected[1], abs=0.02 + 0.02 * abs(expected[1]))
    assert got[4]["time"] == pytest.approx(stock.unwrapped.dt)


def test_a_task_reads_its_own_timestep_and_others_the_chosen_one():
    env = integ_gym.rediscretize(gym.make("HumanoidStandup-v5"), dt=0.001)
    model = env.unwrapped.model
    env.reset(seed=0)
    info = env.step(np.zeros(17, np.float32))[4]
    height = env.unwrapped.data.qpos[2]
    assert info["reward_linup"] == pytest.approx(height / 0.003, rel=1e-12)
    assert (model.opt.timestep, env.unwrapped.frame_skip) == (0.001, 15)
    assert env.unwrapped.data.time == pytest.approx(0.015)
    with pytest.raises(ValueError, match="an action must have shape"):
        env.step(np.zeros(3, np.float32))
    assert (model.opt.timestep, env.unwrapped.frame_skip) == (0.001, 15)


@pytest.mark.parametrize(
    ("dt", "nearest"), [(0.003, "0.00266666666667 or 0.004"), (0.0081, "0.008"), (0.81, "0.008")]
)
def test_a_timestep_that_does_not_divide_is_refused_with_the_nearest_that_do(dt, nearest):
    with pytest.raises(ValueError, match=f"`dt`={dt} s does not .*0.008 s.* nearest valid") as told:
        integ_gym.rediscretize(gym.make("Hopper-v5"), dt=dt)
    values = str(told.value).partition("nearest valid: ")[2]
    assert values == f"{nearest} s"
    for value in values.removesuffix(" s").split(" or "):
        integ_gym.rediscretize(gym.make("Hopper-v5"), dt=float(value))


@pytest.mark.parametrize(
    ("name", "value"), [("integrator", 1), ("success_return", "x"), ("success_return", math.nan)]
)
def test_other_arguments_are_checked_before_anything_is_changed(name, value):
    stock = gym.make("Hopper-v5")
    before = stock.unwrapped.model.opt.timestep, stock.unwrapped.frame_skip
    with pytest.raises(ValueError, match=f"`{name}` must be a .*, got {value!r}"):
        integ_gym.rediscretize(stock, dt=0.001, **{name: value})
    assert (stock.unwrapped.model.opt.timestep, stock.unwrapped.frame_skip) == before


def test_only_mujoco_tasks_are_taken_and_only_once():
    with pytest.raises(ValueError, match=r"unknown integrator of MuJoCo 'Eulr'.*'Euler'"):
        integ_gym.rediscretize(gym.make("HalfCheetah-v5"), integrator="Eulr")
    with pytest.raises(TypeError, match="one of Gymnasium's MuJoCo environments, got CartPoleEnv"):
        integ_gym.rediscretize(gym.make("CartPole-v1"))
    once = integ_gym.rediscretize(gym.make("Hopper-v5"))
    with pytest.raises(TypeError, match="rediscretized already"):
        integ_gym.rediscretize(once)


def _residual(dt, integrator="Euler"):
    """Σ|residual| of a driven inverted pendulum with damping, until it falls."""
    env = integ_gym.rediscretize(gym.make("InvertedPendulum-v5"), integrator=integrator, dt=dt)
    env.reset(seed=2)
    told = [env.step(action)[4] for action in _actions(env, 8, size=0.3)]
    assert all(info["dissipated"] > 0.0 for info in told)
    return sum(abs(info["energy_residual"]) for info in told)


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "discrete"])
def test_the_ledger_of_free_motion_closes_at_the_methods_order(integrator):
    coarse, fine = _residual(0.01, integrator), _residual(0.005, integrator)
    assert 0.0 < fine < coarse
    assert math.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)


def test_penetration_and_violation_are_told():
    env = integ_gym.rediscretize(gym.make("HalfCheetah-v5"))
    env.reset(seed=0)
    told = [env.step(action)[4] for action in _actions(env, 20)]
    assert max(info["penetration"] for info in told) > 1e-4
    assert max(info["constraint_violation"] for info in told) > 1e-4
    assert max(info["solver_iterations"] for info in told) >= 1


def test_an_action_that_is_not_finite_holds_the_last_one():
    env = integ_gym.rediscretize(gym.make("Hopper-v5"))
    env.reset(seed=0)
    env.step(np.full(3, 0.2, np.float32))
    info = env.step(np.array([0.1, np.nan, 0.1], np.float32))[4]
    assert info["fallback_used"]
    assert info["leg_joint_control_applied"] == pytest.approx(0.2)


def test_a_control_at_its_bound_is_saturated_and_recorded_within_it():
    env = integ_gym.rediscretize(gym.make("InvertedPendulum-v5"))
    env.reset(seed=0)
    (high,) = env.action_space.high
    for action, saturated in ((0.5 * high, False), (high, True), (5.0, True), (np.nan, False)):
        info = env.step(np.array([action]))[4]
        assert info["saturated"] is saturated
    told = [info[name] for name in info if name.endswith(("_commanded", "_applied"))]
    assert told == [high, high]


@pytest.mark.parametrize(
    ("joint", "actuator"),
    [('damping="0 5"', ""), ("", 'damping="5"'), ("", 'damping="0 5"')],
)
def test_damping_that_the_ledger_does_not_know_leaves_it_open(joint, actuator, tmp_path):
    text = f"""<mujoco><option timestep="0.01"/><worldbody><body>
    <joint name="slider" type="slide" axis="1 0 0" {joint}/>
    <geom size=".1" mass="1" contype="0" conaffinity="0"/>
    <body><joint name="hinge" type="hinge" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 .6" size=".05" contype="0" conaffinity="0"/></body>
    </body></worldbody><actuator>
    <motor joint="slider" ctrllimited="true" ctrlrange="-3 3" gear="100" {actuator}/></actuator>
    </mujoco>"""
    path = tmp_path / "damped.xml"
    path.write_text(text, encoding="utf-8")
    env = integ_gym.rediscretize(gym.make("InvertedPendulum-v5", xml_file=str(path)))
    env.reset(seed=0)
    info = env.step(np.array([1.0]))[4]
    assert not {"dissipated", "energy_residual"} & info.keys()


def test_success_is_survival_or_a_return():
    falling = integ_gym.rediscretize(gym.make("Hopper-v5"))
    earning = integ_gym.rediscretize(gym.make("Hopper-v5"), success_return=5.0)
    for env, expected in ((falling, False), (earning, True)):
        env.reset(seed=0)
        ended, total = False, 0.0
        while not ended:
            _, reward, terminated, truncated, info = env.step(env.action_space.high)
            total += reward
            ended = terminated or truncated
        assert terminated
        assert total > 5.0
        assert info["success"] is expected


@pytest.mark.parametrize("task", ["HalfCheetah-v5", "InvertedPendulum-v5"])
def test_what_is_not_known_is_left_out(task):
    env = integ_gym.rediscretize(gym.make(task))
    lanes = SequentialVectorEnv(lambda: integ_gym.rediscretize(gym.make(task)), 1)
    env.reset(seed=0)
    lanes.reset(seed=0)
    for action in _actions(env, 30):
        (*_, terminated, _, told), of_lanes = env.step(action), lanes.step(action[None])[-1]
        for name in ("dissipated", "energy_residual"):
            assert of_lanes[f"_{name}"] == (name in told)
            assert of_lanes[name][0] == pytest.approx(told.get(name, math.nan), nan_ok=True)
            assert not math.isnan(told.get(name, 0.0))
        if terminated:
            break


@pytest.mark.parametrize(
    ("chosen", "remedy"),
    [
        ("glfw", "set the environment variable MUJOCO_GL=egl"),
        ("egl", "or set MUJOCO_GL=osmesa before Python starts"),
        ("osmesa", "or set MUJOCO_GL=egl before Python starts"),
    ],
)
def test_a_picture_that_needs_a_display_says_what_to_set(chosen, remedy, monkeypatch):
    env = integ_gym.rediscretize(gym.make("Hopper-v5", render_mode="rgb_array"))
    env.reset(seed=0)

    def no_context(mode):
        raise RuntimeError("an OpenGL platform library has not been loaded into this process")

    monkeypatch.setattr(env.unwrapped.mujoco_renderer, "render", no_context)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    if chosen:
        monkeypatch.setenv("MUJOCO_GL", chosen)
    with pytest.raises(RuntimeError, match=remedy):
        env.render()


def test_an_action_wrapper_stays_and_the_fallback_holds_what_it_takes():
    """Bounds are those of the wrapper: ±1 here, where the motor has ±3."""
    stock = RescaleAction(gym.make("InvertedPendulum-v5"), np.float32(-1.0), np.float32(1.0))
    env = integ_gym.rediscretize(stock, dt=0.01)
    env.reset(seed=0)
    wide = RescaleAction(gym.make("InvertedPendulum-v5"), np.float32(-9.0), np.float32(9.0))
    others = integ_gym.rediscretize(wide, dt=0.01)
    others.reset(seed=0)
    for one, action in ((env, 0.5), (others, 4.5)):
        for given in (action, np.nan):
            info = one.step(np.array([given], np.float32))[4]
            told = [info[name] for name in info if name.endswith(("_commanded", "_applied"))]
            assert told == pytest.approx([action, 1.5])
