"""Gymnasium's MuJoCo tasks under an integrator and timestep of one's choice."""

import math
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import needs
from gymnasium.wrappers import RescaleAction
from pairing import pairs

import integ_gym
from integ_gym.envs import mujoco_ledger, rediscretized
from integ_gym.envs.engines import mujoco_solver
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


def test_lanes_that_are_not_reset_tell_the_same_and_rest_when_they_have_ended():
    def make():
        return integ_gym.rediscretize(gym.make("InvertedPendulum-v5"), action_latency=0.02)

    resting, usual = (SequentialVectorEnv(make, 3, mode) for mode in ("Disabled", "NextStep"))
    for lanes in (resting, usual):
        lanes.reset(seed=[0, 1, 2])
    ended, last = np.zeros(3, dtype=bool), None
    for _ in range(100):
        actions = np.array([[3.0], [0.0], [-3.0]], np.float32)
        *of_resting, told = resting.step(actions)
        *of_usual, expected = usual.step(actions)
        for one, other in zip(of_resting, of_usual, strict=True):
            np.testing.assert_array_equal(one[~ended], other[~ended])
        assert told.keys() == expected.keys()
        for name, values in told.items():
            assert values.dtype == expected[name].dtype
            np.testing.assert_array_equal(values[~ended], expected[name][~ended])
        if ended.any():
            assert not of_resting[1][ended].any()
            np.testing.assert_array_equal(told["time"][ended], last[ended])
        ended, last = of_resting[2] | of_resting[3], told["time"]
        if ended.all():
            break
    assert ended.all()
    assert len(set(last)) > 1


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


INTEGRATORS = ("Euler", "implicit", "implicitfast", "discrete", "RK4")


@pytest.fixture
def undamped(tmp_path) -> str:
    """The inverted pendulum's model without damping: each of its losses is known."""
    from gymnasium.envs import mujoco

    source = Path(mujoco.__file__).parent / "assets" / "inverted_pendulum.xml"
    text = source.read_text(encoding="utf-8")
    assert 'damping="1"' in text
    path = tmp_path / "undamped.xml"
    path.write_text(text.replace('damping="1"', 'damping="0"'), encoding="utf-8")
    return str(path)


def _from(env, q, v, control):
    """What is told of one control period from a state of one's own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(env.unwrapped, "reset_model", lambda: _placed(env.unwrapped, q, v))
        env.reset(seed=0)
    return env.step(np.full(env.action_space.shape, control, np.float32))[4]


def _placed(task, q, v):
    task.set_state(np.array(q), np.array(v))
    return task._get_obs()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_period_in_which_a_limit_acted_is_open_and_every_other_closes(integrator, undamped):
    """Starts at random near the end of the track, at a step of the whole control period.

    A stage of a Runge-Kutta step may be beyond it where the last one is not.
    """
    stock = gym.make("InvertedPendulum-v5", xml_file=undamped)
    env = integ_gym.rediscretize(stock, integrator=integrator, dt=0.04)
    free = integ_gym.rediscretize(
        gym.make("InvertedPendulum-v5", xml_file=undamped), integrator=integrator, dt=0.04
    )
    free.unwrapped.model.jnt_limited[:] = 0
    rng, opened = np.random.default_rng(0), 0
    for _ in range(240):
        x = rng.choice([-1.0, 1.0]) * rng.uniform(0.8, 1.05)
        q, v = (x, rng.uniform(-1.5, 1.5)), rng.uniform(-4.0, 4.0, 2)
        control = rng.uniform(-3.0, 3.0)
        told, known = _from(env, q, v, control), _from(free, q, v, control)
        acted = bool((env.state != free.state).any())
        if acted:
            assert "energy_residual" not in told
        elif "energy_residual" in told:
            assert told["energy_residual"] == known["energy_residual"]
        opened += "energy_residual" not in told
    assert 30 < opened < 150


def test_a_divergence_ends_the_episode_where_mujoco_would_start_it_anew():
    env = integ_gym.rediscretize(gym.make("InvertedPendulum-v5"))
    env.reset(seed=0)
    last, earned, *_ = env.step(np.zeros(1, np.float32))
    env.unwrapped.data.qvel[:] = 1e7
    observation, reward, terminated, _, info = env.step(np.zeros(1, np.float32))
    assert terminated
    assert info["solver_status"] == "diverged"
    assert (observation == last).all()
    assert earned == 1.0
    assert reward == -earned
    assert not info["success"]


def test_a_divergence_pays_the_least_reward_for_all_that_was_left():
    env = integ_gym.rediscretize(gym.make("HalfCheetah-v5"))
    env.reset(seed=0)
    rewards = [env.step(env.action_space.high)[1] for _ in range(20)]
    env.unwrapped.data.qvel[:] = 1e7
    assert min(rewards) < 0.0
    expected = min(rewards) * (1000 - 20) - max(0.0, sum(rewards))
    assert env.step(env.action_space.high)[1] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("task", "integrator", "known"),
    [("Swimmer-v5", "RK4", False), ("InvertedPendulum-v5", "RK4", False),
     ("InvertedPendulum-v5", "Euler", True)],
)  # fmt: skip
def test_what_a_diverged_period_lost_is_unknown_where_losses_are(task, integrator, known):
    """Where they are known, the period is taken back and nothing is booked."""
    env = integ_gym.rediscretize(gym.make(task), integrator=integrator)
    env.reset(seed=0)
    env.unwrapped.data.qvel[:] = 1e7
    info = env.step(np.zeros(env.action_space.shape, np.float32))[4]
    assert info["solver_status"] == "diverged"
    assert env.setup.engine.describe()["losses_accounted"] is known
    for name in ("energy_residual", "dissipated"):
        assert info.get(name) == (0.0 if known else None)


def test_a_mujoco_that_resets_is_told_from_one_that_moves(monkeypatch):
    """Before 3.2 MuJoCo resets what diverges, in a first step too; it has no flag against that."""
    for module in (mujoco_solver, mujoco_ledger, rediscretized):
        monkeypatch.setattr(module, "NO_RESET", "mjDSBL_UNKNOWN")
    env = integ_gym.rediscretize(gym.make("Hopper-v5"))
    for speed, status in ((0.0, "ok"), (1e12, "diverged"), (0.0, "ok")):
        env.reset(seed=0)
        env.unwrapped.data.qvel[:] += speed
        assert env.step(np.zeros(3, np.float32))[4]["solver_status"] == status


EXPLOSION = """
import gymnasium, integ_gym, numpy
for task, speed in (("Hopper-v5", 1e8), ("Ant-v5", 9e5)):
    for integrator in {integrators!r}:
        env = integ_gym.rediscretize(gymnasium.make(task), integrator=integrator)
        for seed in range(2):
            env.reset(seed=seed)
            env.unwrapped.data.qvel[:] = speed
            info = env.step(numpy.zeros(env.action_space.shape, numpy.float32))[4]
            assert info["solver_status"] == "diverged", info
"""


def test_a_divergence_is_told_and_not_written_about(tmp_path):
    """Nothing on the terminal and no MUJOCO_LOG.TXT in the user's folder."""
    script = EXPLOSION.format(integrators=INTEGRATORS)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
    assert not list(tmp_path.iterdir())
