"""Testbeds of robots' models: their episodes are those of a plain loop of MuJoCo's."""

import importlib
import os
import subprocess
import sys
import warnings
from ctypes.util import find_library

import gymnasium as gym
import mujoco
import numpy as np
import onnx
import pytest
from examples.robots.monoped import Monoped
from gymnasium.utils.env_checker import check_env
from house import ROOT, page_blocks
from swaying import MONOPED, record_swaying

import integ_gym
from integ_gym import Discretization, IntegGymError, MjcfTestbed, cli
from integ_gym.envs.testbeds import mjcf_lanes
from integ_gym.envs.testbeds.making import find_testbed, make_checked
from integ_gym.envs.testbeds.mjcf_batch import steps_in_batch
from integ_gym.envs.testbeds.mjcf_model import compile_model
from integ_gym.eval.panel.cells import Cell
from integ_gym.eval.panel.episodes import Subject, evaluate
from integ_gym.eval.panel.home import provenance
from integ_gym.eval.panel.spec import PanelSpec
from integ_gym.evidence.fields import VOLATILE_NAMES
from integ_gym.evidence.replaying import play_substeps, replay
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.baselines import make_baseline
from integ_gym.train.policy_files.onnx import OnnxPolicy, onnx_bytes
from integ_gym.train.policy_files.safetensors_file import read_safetensors
from integ_gym.train.policy_files.sidecar import stated_arguments

MODEL = """
<mujoco>
  <compiler inertiafromgeom="{from_geoms}"/>
  <option timestep="0.005" integrator="implicitfast" iterations="7" cone="elliptic"/>
  <asset><mesh name="shell" file="shell.stl"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="trunk" pos="0 0 0.5">
      <freejoint/>
      {inertial}
      <geom type="box" size="0.1 0.1 0.1"/>
      <geom name="shell" type="mesh" mesh="shell" {contact}/>
      <site name="imu"/>
      <body>
        <joint name="a" axis="1 0 0" range="-1 1"/><joint name="b" axis="0 1 0"/>
        <joint name="c"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="p" joint="a" kp="20" kv="2" ctrlrange="-1 1" forcerange="-5 5"/>
    <velocity name="v" joint="b" kv="3"/>
    <motor name="m" joint="c" gear="4"/>
  </actuator>
  <sensor><gyro name="gyro" site="imu"/><velocimeter name="local_linvel" site="imu"/></sensor>
  <keyframe><key name="home" qpos="0 0 0.5 1 0 0 0 0.1 0 0" ctrl="0.1 0 0"/></keyframe>
</mujoco>
"""
HIDDEN = 'contype="0" conaffinity="0"'
HEAVY = '<inertial pos="0 0 0" mass="3" diaginertia="0.1 0.1 0.1"/>'


pytestmark = pytest.mark.usefixtures("robots_found")


class Stub(MjcfTestbed):
    """A robot that may lack what its arguments say."""

    control_period = 0.02
    keyframe = "home"

    def model(self, contact=HIDDEN, inertial=HEAVY, from_geoms="auto"):
        from mujoco import MjSpec

        return MjSpec.from_string(
            MODEL.format(contact=contact, inertial=inertial, from_geoms=from_geoms)
        )

    def observe(self, robot, memory, command):
        return robot.sensor("gyro")

    def act(self, action, robot):
        return action


def plain_states(model, start, decide, integrator, dt, periods, late=0, seen_late=0, **options):
    """States at the decisions of an episode, and what is decided about them late.

    Args:
        model: compiled.
        start: positions, velocities and the controls that act first.
        decide: from `MjData` to controls.
        integrator: MuJoCo's name.
        dt: timestep, s.
        periods: decisions.
        late: timesteps by which controls are late.
        seen_late: timesteps by which what is decided about is old.
        options: of the model.
    """
    import mujoco

    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model.opt.timestep = dt
    for name, value in options.items():
        setattr(model.opt, name, value)
    data, states, count = mujoco.MjData(model), [], round(0.02 / dt)
    data.qpos[:], data.qvel[:], idle = start
    data.ctrl[:] = idle
    seen, orders = [], []
    for _ in range(periods):
        for step in range(count):
            mujoco.mj_forward(model, data)
            now = mujoco.MjData(model)
            mujoco.mj_copyData(now, model, data)
            seen.append(now)
            if step == 0:
                orders += [decide(seen[max(0, len(seen) - 1 - seen_late)])] * count
            place = len(seen) - 1 - late
            data.ctrl[:] = idle if place < 0 else orders[place]
            mujoco.mj_step(model, data)
        states.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(states)


@pytest.mark.parametrize(
    ("integrator", "dt", "solver", "late", "seen_late"),
    [
        ("Euler", 0.004, {}, 0, 0),
        ("implicitfast", 0.004, {"iterations": 100}, 0, 0),
        ("RK4", 0.002, {"iterations": 4}, 3, 0),
        ("Euler", 0.001, {}, 25, 7),
    ],
)
def test_an_episode_is_that_of_a_plain_loop_to_the_last_bit(
    integrator, dt, solver, late, seen_late
):
    testbed = find_testbed(MONOPED, {"solver": solver})
    place = Discretization(integrator, dt, 0.02, "mujoco")
    delays = {"action_latency": late * dt, "observation_latency": seen_late * dt}
    made = make_checked(testbed, place, 1, **delays)
    (env,) = made.envs
    observation, _ = env.reset(seed=3)
    data = env.unwrapped.data
    q, v = data.qpos.copy(), data.qvel.copy()
    actions, states = [], []
    for _ in range(30):
        action = 0.5 * np.tanh(observation[10:13]).astype(np.float32)
        observation, _, fallen, _, info = env.step(action)
        actions.append(action)
        states.append(np.concatenate([data.qpos, data.qvel]))
        assert np.isfinite(observation).all()
        assert not fallen

    model = testbed.compiled.model.__copy__()
    key = model.key("crouch")

    def decide(data):
        angles = (data.qpos[3:] - key.qpos[3:]).astype(np.float64)
        return key.ctrl + 0.5 * (0.5 * np.tanh(angles).astype(np.float32)).astype(np.float64)

    start = q, v, key.ctrl
    expected = plain_states(model, start, decide, integrator, dt, 30, late, seen_late, **solver)
    assert (np.array(states) == expected).all()
    assert info["hip_action_applied"] == actions[-1 - (late * dt >= 0.02)][0] or late == 3


def test_home_and_actuators_are_those_of_the_file():
    testbed = Stub()
    with pytest.warns(UserWarning, match=r"1 files .*shell\.stl"):
        env = testbed.environment()
    setup = env.setup
    assert testbed.home == Discretization("implicitfast", 0.005, 0.02, "mujoco")
    solver = setup.settings.solver
    assert (solver["iterations"], solver["cone"], solver["eulerdamp"]) == (7, "elliptic", True)
    position, velocity, motor = setup.engine.describe()["actuators"]
    assert position == {
        "name": "p", "joint": "a", "kind": "position", "kp": 20.0, "kv": 2.0,
        "ctrlrange": [-1.0, 1.0], "forcerange": [-5.0, 5.0],
    }  # fmt: skip
    assert (velocity["kind"], velocity["kv"]) == ("velocity", 3.0)
    assert (motor["kind"], motor["gear"][0]) == ("motor", 4.0)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"contact": ""}, "'shell'"),
        ({"inertial": ""}, "'trunk'"),
        ({"from_geoms": "true"}, "'trunk'"),
        ({"contact": "", "inertial": ""}, "shell.stl"),
        ({"friction": 1.0}, "friction"),
        ({"inertial": "<no/>"}, "no"),
    ],
)
def test_a_model_that_would_be_another_is_refused_by_name(arguments, named):
    with pytest.raises((IntegGymError, ValueError), match=named):
        Stub(**arguments).environment()


def changed(**members):
    return type("Changed", (Stub,), members)()


@pytest.mark.parametrize(
    ("testbed", "named"),
    [
        ({"keyframe": "hom"}, "home"),
        ({"observe": lambda self, robot, memory, command: robot.sensor("gyr")}, "gyro"),
        ({"observe": lambda self, robot, memory, command: robot.gravity("im")}, "imu"),
        ({"act": lambda self, action, robot: action[:2]}, "act"),
        ({"actions": 4}, r"shape \(4,\), got \(3,\)"),
        ({"start": lambda self, robot, rng: robot.data.qpos}, "in place"),
        ({"observe": lambda self, robot, memory, command: robot.sensor("")}, "gyro"),
        ({"measure": lambda self, robot: [1.0]}, "measure"),
        ({"control_period": 0.012}, "control_period"),
        ({"duration": -1.0}, "duration"),
        ({"control_period": property()}, "control_period"),
        ({"model": lambda self: "nowhere.xml"}, "nowhere.xml"),
        ({"largest_error": 0.1}, "measure"),
    ],
)
def test_what_a_user_gets_wrong_is_told_in_a_sentence(testbed, named):
    with warnings.catch_warnings(action="ignore"), pytest.raises(IntegGymError, match=named):
        changed(**testbed).environment().step(np.zeros(3, np.float32))


@pytest.mark.parametrize(
    "member",
    [
        {"act": lambda self, action, robot: np.add(robot.key_ctrl, action, out=robot.key_ctrl)},
        {"act": lambda self, action, robot: np.multiply(action, 0.5, out=action)},
        {"observe": lambda self, robot, memory, command: np.negative(command, out=command)},
    ],
)
def test_what_outlives_a_call_cannot_be_changed_in_it(member):
    with warnings.catch_warnings(action="ignore"), pytest.raises(ValueError, match="read-only"):
        changed(commands={"v_x": (0.0, 1.0)}, **member).environment().step(np.ones(3, np.float32))


class Scaled(Stub):
    """It scales what it reads in place, and gives its controls in one array of its own."""

    def observe(self, robot, memory, command):
        spin = robot.sensor("gyro")
        spin *= 0.25
        return spin

    def act(self, action, robot):
        self.controls = vars(self).setdefault("controls", np.zeros(3))
        self.controls[:] = action
        return self.controls


@pytest.mark.filterwarnings("ignore:.*shell.stl")
def test_what_a_users_methods_do_to_their_own_arrays_changes_no_motion():
    states = []
    for testbed in (Stub(action_latency=0.02), Scaled(action_latency=0.02)):
        env = testbed.environment()
        env.reset(seed=0)
        for turn in range(5):
            env.step(np.full(3, (-0.9) ** turn, np.float32))
        data = env.unwrapped.data
        states.append(np.concatenate([data.qpos, data.qvel, data.sensordata]))
    assert (states[0] == states[1]).all()


def test_it_is_an_environment_of_gymnasium():
    testbed = find_testbed(MONOPED, {})
    env = testbed.environment(duration=1.0)
    with warnings.catch_warnings(action="error"):
        warnings.filterwarnings("ignore", message=".*(minimum|maximum) value.*infinity")
        warnings.filterwarnings("ignore", message=".*not within the observation space.*")
        warnings.filterwarnings("ignore", message=".*different from the unwrapped version")
        check_env(env, skip_render_check=True)
    gym.register("Monoped-v0", entry_point=lambda **own: find_testbed(MONOPED, own).environment())
    vector = gym.make_vec("Monoped-v0", 2, vectorization_mode="sync")
    seen, info = vector.reset(seed=0)
    assert seen.shape == (2, 20)
    assert (info["command"] >= 0.3).all()
    assert info["command"][0] != info["command"][1]
    *_, ended, limited, info = vector.step(np.full((2, 3), 2.0, np.float32))
    assert not (ended | limited).any()
    assert info["saturated"].all()
    vector.close()
    again = testbed.environment().reset(seed=0)[0]
    assert (seen[0] == again).all()


DRAWING = f"""
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.support.errors import SetupError

env = find_testbed({MONOPED!r}, {{}}).environment(render_mode="rgb_array")
env.reset(seed=0)
try:
    frame = env.render()
    print(frame.shape, frame.dtype, frame.std() > 1.0)
except SetupError as error:
    print(error)
"""


@pytest.mark.parametrize("interface", ["egl", "glfw"])
def test_it_is_drawn_where_a_context_can_be_had_else_told_what_to_set(interface):
    surroundings = {**os.environ, "MUJOCO_GL": interface, "PYTHONPATH": str(ROOT)}
    surroundings.pop("DISPLAY", None)
    command = [sys.executable, "-c", DRAWING]
    drawn = subprocess.run(command, env=surroundings, capture_output=True, text=True, check=True)
    can = interface == "egl" and find_library("EGL") is not None
    expected = "(480, 480, 3) uint8 True" if can else "MuJoCo has no OpenGL context"
    assert drawn.stdout.startswith(expected)


def test_who_stands_presses_with_the_weight_and_does_not_slip():
    env = find_testbed(MONOPED, {}).environment()
    env.reset(seed=0)
    names = [told.name for told in env.setup.plant.further]
    env.unwrapped.data.qpos[1] += 0.5
    *_, info = env.step(np.zeros(3, np.float32))
    flying = dict(zip(names, info["further"], strict=True))
    assert flying["foot_normal_force"] == flying["contact_normal_force"] == 0.0
    env.reset(seed=0)
    for _ in range(90):
        *_, fallen, _, info = env.step(np.zeros(3, np.float32))
    told = dict(zip(names, info["further"], strict=True))
    model, data = env.unwrapped.model, env.unwrapped.data
    assert not fallen
    assert told["foot_normal_force"] == told["contact_normal_force"]
    assert told["foot_normal_force"] == pytest.approx(9.81 * model.body_subtreemass[0], rel=0.02)
    assert told["foot_tangential_force"] <= 0.9 * told["foot_normal_force"]
    assert told["foot_slip_speed"] < 1e-3
    assert told["knee_force"] == data.actuator_force[1]
    assert (told["command_v_x"], told["measured_v_x"]) == (info["command"][0], data.qvel[0])


@pytest.mark.parametrize(
    "different", [{}, {"solver": {"iterations": 100}, "latency_jitter": 0.008}]
)
def test_a_record_comes_out_to_the_last_bit(different, tmp_path):
    testbed = find_testbed(MONOPED, {"duration": 0.6})
    made = make_checked(testbed, testbed.home, 1, **different)
    file, record = record_swaying(made, tmp_path, 30)
    assert record.fields["env_id"] == MONOPED
    assert record.fields["engine_description"].count("position") == 3
    errors = record.trace["command_v_x"] - record.trace["measured_v_x"]
    assert record["command_error"] == pytest.approx(np.sqrt(np.nanmean(errors**2)))
    assert np.nanmax(record.trace["foot_normal_force"]) > 0.0
    done = replay([(file, record)], exact=True, own_code=True).settle()
    assert (done.findings, done.skipped, done.exact) == ([], {}, 1)
    assert replay([(file, record)]).settle().skipped
    name, steps = record["record_id"], play_substeps(record, own_code=True)
    others = ("time", "_force", "iterations")
    motion = [own for own in steps if own in record.trace and not own.endswith(others)]
    assert {"knee", "knee_dot"} <= set(motion)
    for column in motion:
        np.testing.assert_array_equal(steps[column][4::5], record.trace[column][1:])
    command = ["evidence", "show", str(tmp_path), name[:8], "--substeps", str(tmp_path / "s.csv")]
    assert cli.main([*command, "--own-code"]) == 0
    assert len((tmp_path / "s.csv").read_text("utf-8").splitlines()) == 1 + len(steps["time"])
    with pytest.raises(IntegGymError, match="own-code"):
        play_substeps(record)
    record.trace["reward"] = record.trace["reward"] + 1e-9
    assert replay([(file, record)], exact=True, own_code=True).settle().findings


@pytest.mark.parametrize(
    "different",
    [{}, {"action_latency": 0.004, "observation_latency": 0.024, "hold_probability": 0.2}],
)
@pytest.mark.parametrize("kind", ["network", "graph", "random"])
def test_a_record_is_the_same_whoever_runs_beside(kind, different, tmp_path, monkeypatch):
    spec = PanelSpec(
        name="together", env_id=MONOPED, environment={"duration": 2.0, **different}, train=(),
        control_period=0.02, grid=(find_testbed(MONOPED, {}).home,), seeds=(), episodes=5,
        ladder=False,
    )  # fmt: skip
    policy = make_baseline("random", spec.nominal)
    if kind != "random":
        policy = read_safetensors(
            ROOT / "examples" / "robots" / "monoped_policy" / "policy.safetensors"
        )
    if kind == "graph":
        graph = onnx.load_model_from_string(onnx_bytes(policy, {}))
        graph.graph.input[0].type.tensor_type.shape.dim[0].dim_value = 1
        policy = OnnxPolicy(graph.SerializeToString())
    subject = Subject(policy, (Cell.of(*spec.grid, "grid"),))
    tables = []
    for room, together in ((1, False), (1, True), (3, False), (3, True), (5, True)):
        monkeypatch.setattr(MjcfTestbed, "room", lambda *cell, room=room: room)
        monkeypatch.setattr(Monoped, "together", together)
        (table,) = evaluate(spec, [subject], range(5), EvidenceStore(tmp_path), {})
        tables.append(table.drop_columns([*VOLATILE_NAMES]).sort_by("episode_index"))
    others = [make_baseline(name, spec.nominal) for name in ("zero", "random") if name != kind]
    beside = [subject, *(Subject(other, subject.cells) for other in others)]
    (table,) = evaluate(spec, beside, range(5), EvidenceStore(tmp_path), {})
    own = [name == policy.policy_id for name in table["policy_id"].to_pylist()]
    tables.append(table.filter(own).drop_columns([*VOLATILE_NAMES]).sort_by("episode_index"))
    assert all(table.equals(tables[0]) for table in tables[1:])
    assert tables[0]["seed"].to_pylist() == [1000, 1001, 1002, 1003, 1004]
    assert kind != "random" or len(set(tables[0]["length"].to_pylist())) > 1


def test_a_batch_tells_what_is_read_after_each_timestep(monkeypatch):
    testbed, told = find_testbed(MONOPED, {"duration": 2.0}), []
    for is_batch in (True, False):
        monkeypatch.setattr(mjcf_lanes, "steps_in_batch", lambda *model, own=is_batch: own)
        place = Discretization("implicitfast", 0.02, 0.02, "mujoco")
        lanes, rng = testbed.make(place, 6, autoreset_mode="Disabled"), np.random.default_rng(0)
        _, info = lanes.reset(seed=3)
        lanes.unwrapped._lane_data.rows["qvel"][4, 3:] = 9e5
        ended, parts, limits = np.zeros(6, bool), [], 0.0
        while not ended.all():
            *seen, terminated, truncated, info = lanes.step(rng.uniform(-1.0, 1.0, (6, 3)))
            ended = terminated | truncated
            parts += [*seen, terminated, *info.values(), lanes.unwrapped.state]
            limits = max(limits, (info["constraint_violation"] - info["penetration"]).max())
        told.append(parts)
        assert limits > 0.1
        assert info["solver_status"].tolist().count("diverged") == 1
    for one, other in zip(*told, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("old", "new", "is_told"),
    [
        ("", "", True),
        ('integrator="Euler"', 'integrator="RK4"', False),  # contacts of another stage
        ('eulerdamp="disable"', 'limit="disable"', False),
        ('eulerdamp="disable"', 'sensor="disable"', False),
        ('eulerdamp="disable"', 'override="enable"', False),
        ("<worldbody>", '<equality><joint joint1="knee"/></equality><worldbody>', False),
        ('conaffinity="1"', 'conaffinity="1" gap="0.01"', False),  # contacts that do not act
    ],
)
def test_what_a_batch_does_not_tell_is_read_one_by_one(old, new, is_told):
    model = (ROOT / "examples" / "robots" / "monoped.xml").read_text("utf-8").replace(old, new)
    assert steps_in_batch(mujoco, mujoco.MjModel.from_xml_string(model)) is is_told


def test_robots_that_act_together_begin_together_and_show_arrays_alone():
    lanes = find_testbed(MONOPED, {}).make(
        Discretization("Euler", 0.004, 0.02, "mujoco"), 3, autoreset_mode="Disabled"
    )
    lanes.reset(seed=1)
    robot = lanes.unwrapped._acting.robot
    assert robot.data.xpos.shape[0] == 3
    for name in ("body", "efc_pos", "contact"):
        with pytest.raises(IntegGymError, match=name):
            getattr(robot.data, name)
    with pytest.raises(IntegGymError, match="together"):
        lanes.reset(seed=1, options={"reset_mask": np.array([True, False, False])})


@pytest.mark.parametrize("mode", ["NextStep", "Disabled"])
def test_a_success_follows_its_command(mode, monkeypatch):
    testbed = find_testbed(MONOPED, {"duration": 0.3})
    monkeypatch.setattr(Monoped, "achieves", MjcfTestbed.achieves)
    error = np.zeros(2)
    for share, follows in ((None, [True, True]), (0.999, [False, False]), (1.001, [True, False])):
        bound = None if share is None else share * error.min()
        monkeypatch.setattr(Monoped, "largest_error", bound)
        lanes, squares = testbed.make(testbed.home, 2, autoreset_mode=mode), 0.0
        lanes.reset(seed=5)
        names = [one.name for one in lanes.setup.plant.further]
        for _ in range(15):
            *_, fallen, _, info = lanes.step(np.zeros((2, 3), np.float32))
            told = dict(zip(names, info["further"].T, strict=True))
            squares += (told["measured_v_x"] - told["command_v_x"]) ** 2
        error = np.sqrt(squares / 15)
        assert not fallen.any()
        assert info["success"][np.argsort(error)].tolist() == follows


def test_the_example_of_the_page_takes_a_file(tmp_path, monkeypatch):
    (block,) = [one for one in page_blocks("docs/how-to/own_robot.md", "python") if "Mjcf" in one]
    (tmp_path / "my_robot.py").write_text(block, encoding="utf-8")
    (tmp_path / "scene.xml").write_text(
        MODEL.format(contact=HIDDEN, inertial=HEAVY, from_geoms="auto"), encoding="utf-8"
    )
    monkeypatch.syspath_prepend(tmp_path)
    testbed = find_testbed("my_robot:Walker", {"folder": str(tmp_path)})
    with pytest.warns(UserWarning, match="shell"):
        env = testbed.environment()
    observation, info = env.reset(seed=0)
    assert observation.shape == (3 + 3 + 3 * 3 + 1,)
    assert 0.0 <= info["command"][0] <= 1.0
    assert env.step(np.zeros(3, np.float32))[2] is False
    assert testbed.success.goal == "no fall within `duration` (the trunk tips by more than 60°)"
    arguments = stated_arguments("stock", "my_robot:Walker", {"folder": str(tmp_path)})
    assert arguments == testbed.home.arguments()


def _shell(size):
    """A tetrahedron as the bytes of an STL file."""
    corners = np.array([[0, 0, 0], [size, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    faces = corners[[(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]].astype("<f4")
    facets = b"".join(bytes(12) + face.tobytes() + bytes(2) for face in faces)
    return bytes(80) + (4).to_bytes(4, "little") + facets


@pytest.mark.parametrize("in_memory", [False, True])
def test_a_changed_mesh_is_another_model(in_memory, tmp_path):
    from mujoco import MjSpec

    hashes = set()
    for size in (0.1, 0.2, 0.1):
        text = MODEL.format(contact=HIDDEN, inertial=HEAVY, from_geoms="auto")
        if in_memory:
            spec = MjSpec.from_string(text, assets={"shell.stl": _shell(size)})
        else:
            (tmp_path / "shell.stl").write_bytes(_shell(size))
            (spec := MjSpec.from_string(text)).modelfiledir = str(tmp_path)
        compiled = compile_model(spec)
        assert compiled.model.nmesh == 1
        hashes.add(compiled.sha256)
    assert len(hashes) == 2


@pytest.mark.parametrize("names", ['type="2d" file="t.png"', 'type="cube" fileright="t.png"'])
def test_a_changed_texture_is_another_model(names, tmp_path):
    from mujoco import MjSpec
    from PIL import Image

    text = (
        '<mujoco><compiler meshdir="shapes" texturedir="colours"/><asset><texture name="t" '
        f'{names}/></asset><worldbody><geom size="1"/></worldbody></mujoco>'
    )
    hashes = set()
    for folder, grey in (("shapes", 0), ("colours", 0), ("colours", 9), ("colours", 0)):
        (tmp_path / folder).mkdir(exist_ok=True)
        Image.fromarray(np.full((4, 4, 3), grey, np.uint8)).save(tmp_path / folder / "t.png")
        if folder == "colours":
            (spec := MjSpec.from_string(text)).modelfiledir = str(tmp_path)
            hashes.add(compile_model(spec).sha256)
    assert len(hashes) == 2


def test_an_argument_that_is_not_the_codes_own_is_told():
    given = {"inertial": HEAVY.replace("3", "4"), "contact": HIDDEN}
    env_id = f"{__name__}:Stub"
    with pytest.warns(UserWarning, match="shell"):
        known, _ = provenance(env_id, None, "stock", given)
    assert known.overridden == {"inertial": HEAVY}


@pytest.mark.slow
def test_the_monoped_hops_at_home_and_is_judged_elsewhere(tmp_path):
    panel = integ_gym.evaluate(
        ROOT / "examples" / "robots" / "monoped_policy" / "policy.safetensors", MONOPED, tmp_path,
        integrators=["Euler", "implicitfast"], dts=[0.004], episodes=10,
        varied={"solver": [{"iterations": 1}, {"iterations": 100}]}, at=["home"], limit=False,
        workers=1, progress=False, on_doubt=lambda doubt: None,
    )  # fmt: skip
    assert {cell.integrator for cell in panel.cells} == {"Euler", "implicitfast"}
    records = [one.fields for _, one in EvidenceStore(tmp_path / "evidence").named_records()]
    at_home = [one["success"] for one in records if one["policy_id"].startswith("ppo")
               and one["cell"] == "mujoco Euler dt=0.004"]  # fmt: skip
    assert len(at_home) == 10
    assert np.mean(at_home) >= 0.5
    idle = [one["success"] for one in records if one["policy_id"] == "zero"]
    assert not any(idle)


ROBOTS = {
    "go1": ("Go1", 48, None), "g1": ("G1", 103, 1.5), "t1": ("T1", 85, 1.5),
    "berkeley_humanoid": ("BerkeleyHumanoid", 52, 1.5), "apollo": ("Apollo", 112, 1.5833333333),
}  # fmt: skip
"""Module of a published robot to its class, the numbers that its policy takes, and the frequency of
its gait at a command of 1."""


@pytest.mark.parametrize("module", ROBOTS)
def test_a_published_robot_sees_what_its_policy_takes(module):
    name, size, frequency = ROBOTS[module]
    file = ROOT / "examples" / "robots" / f"{module}.py"
    assert len(file.read_text(encoding="utf-8").splitlines()) <= 50
    kind = getattr(importlib.import_module(f"examples.robots.{module}"), name)
    phases = 4 if frequency else 0
    joints = (size - 12 - phases) // 3
    chain = "".join(f'<body><joint name="j{k}"/><geom size="0.05"/></body>' for k in range(joints))
    unit = getattr(kind, "unit", "imu")
    model = f"""
    <mujoco><worldbody><body pos="0 0 2"><freejoint/><geom size="0.1"/><site name="{unit}"/>{chain}
    </body></worldbody>
    <actuator>{"".join(f'<position joint="j{k}" kp="9"/>' for k in range(joints))}</actuator>
    <sensor><gyro name="{getattr(kind, "gyro", "gyro")}" site="{unit}"/><velocimeter site="{unit}"
      name="{getattr(kind, "velocimeter", "local_linvel")}"/></sensor>
    <keyframe><key name="{kind.keyframe}" qpos="0 0 2 1 0 0 0 {"0.2 " * joints}"
      ctrl="{"0.2 " * joints}"/></keyframe></mujoco>"""

    def own_model(self):
        from mujoco import MjSpec

        return MjSpec.from_string(model)

    command = np.array([1.0, 0.0, 0.0])
    members = {"model": own_model, "draw_command": lambda self, rng: command}
    env = type(name, (kind,), members)().environment()
    observation, _ = env.reset(seed=1)
    assert observation.shape == (size,)
    assert observation[6:9] == pytest.approx([0.0, 0.0, -1.0])
    action = np.linspace(-1.0, 1.0, joints, dtype=np.float32)
    observation, *_ = env.step(action)
    end = size - phases - (0 if frequency else 3)
    assert (observation[end - joints : end] == action).all()
    assert (command == (observation[9:12] if frequency else observation[-3:])).all()
    if frequency:
        turn = 2.0 * np.pi * frequency * 0.02
        assert observation[-4:] == pytest.approx(
            [np.cos(turn), -np.cos(turn), np.sin(turn), -np.sin(turn)]
        )
        members["draw_command"] = lambda self, rng: np.zeros(3)
        stopped, _ = type(name, (kind,), members)().environment().reset(seed=1)
        cosines = [-1.0, -1.0] if name in ("T1", "Apollo") else [1.0, -1.0]
        assert stopped[-4:] == pytest.approx([*cosines, 0.0, 0.0])
