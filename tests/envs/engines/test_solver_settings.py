"""Settings of solvers: given, read back, recorded, the same in all forms of an environment."""

import json

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from engine_cases import EVERY, needs

import integ_gym
from integ_gym import IntegGymError
from integ_gym.cli import main
from integ_gym.envs import numerics
from integ_gym.envs.engines.mujoco_solver import SETTINGS, read_solver, write_solver
from integ_gym.envs.engines.stepping import has_solver, integrators_of
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import INTEGRATORS

NATIVE = [("native", name) for name in ("implicit_euler", "implicit_midpoint", "stormer_verlet")]
PENDULUM = "IntegPendulum-v0"


def hold(observation):
    """No torque."""
    return [0.0]


@pytest.mark.slow
def test_a_home_with_settings_is_judged_where_others_have_no_solver_and_verified(tmp_path, capsys):
    home = {"integrator": "implicit_midpoint", "dt": 0.05, "control_period": 0.05}
    panel = integ_gym.evaluate(
        hold, PENDULUM, tmp_path / "out", home=home, integrators=["implicit_midpoint", "rk4"],
        dts=[0.05], episodes=2, workers=1, progress=False,
        environment={"duration": 0.5, "solver": {"tolerance": 1e-3}},
        varied={"solver": {"iterations": [1]}},
    )  # fmt: skip
    names = {cell.name for cell in panel.cells}
    assert {"reference dt=0.05", "rk4 dt=0.05"} < names
    assert [name for name in names if "solver" in name] == [
        "implicit_midpoint dt=0.05, solver.iterations=1"
    ]
    rows = integ_gym.EvidenceStore(tmp_path / "out" / "evidence").query(
        "SELECT cell, arguments FROM records WHERE phase = 'evaluation'"
    )
    given = {
        row["cell"]: json.loads(row["arguments"]).get("solver", {}).get("value")
        for row in rows.to_pylist()
    }
    assert given["implicit_midpoint dt=0.05"] == {"tolerance": 1e-3}
    changed = {"tolerance": 1e-3, "iterations": 1}
    assert given["implicit_midpoint dt=0.05, solver.iterations=1"] == changed
    assert given["rk4 dt=0.05"] is given["reference dt=0.05"] is None
    assert main(["evidence", "verify", str(tmp_path / "out"), "--all", "--no-progress"]) == 0
    assert "to the last bit" in capsys.readouterr().out


def test_a_coarse_tolerance_takes_fewer_iterations_and_one_below_rounding_is_refused():
    found = []
    for tolerance in (1e-10, 1e-2):
        env = gym.make(
            PENDULUM, integrator="implicit_euler", dt=0.2, solver={"tolerance": tolerance}
        )
        env.reset(options={"state": (1.0, 3.0)})
        found.append(env.step([1.0])[4]["solver_iterations"])
    assert found[1] < found[0]
    with pytest.raises(IntegGymError, match="rounding leaves no smaller residual"):
        gym.make(PENDULUM, integrator="implicit_euler", solver={"tolerance": 1e-30})


def test_integrators_without_a_solver_are_known_without_their_simulator():
    solving = {"implicit_euler", "implicit_midpoint", "stormer_verlet"}
    assert {name for name in INTEGRATORS.names() if has_solver("native", name)} == solving
    newton = {name for name in integrators_of("newton") if not has_solver("newton", name)}
    assert newton == {"featherstone"}


@pytest.mark.parametrize(
    ("engine", "integrator", "name", "value"),
    [
        ("mjx", "Euler", "noslip_iterations", 3),
        ("native", "implicit_euler", "iterations", float("inf")),
    ],
)
def test_what_could_not_act_is_refused(engine, integrator, name, value):
    needs(engine)
    with pytest.raises(IntegGymError, match="solver"):
        _engine(engine, integrator, **{name: value})


def _engine(engine, integrator, **solver):
    given = {"engine": engine, "integrator": integrator, "solver": solver or None}
    return environment_setup(PENDULUM, given).engine


def _settings(engine, integrator, **solver):
    return _engine(engine, integrator, **solver).settings


def _other(name, value):
    if name == "float_width":
        return 32
    return value + 1 if isinstance(value, int) else 2.0 * value


@pytest.mark.parametrize(("engine", "integrator"), [*NATIVE, *EVERY])
def test_every_number_that_is_listed_can_be_changed_and_is_recorded(engine, integrator):
    needs(engine)
    own = _settings(engine, integrator)
    numbers = {name: x for name, x in own.items() if type(x) in (int, float) and x > 0}
    changed = {name: _other(name, value) for name, value in numbers.items()}
    if changed:
        made = _engine(engine, integrator, **changed)
        found = {name: made.settings[name] for name in changed}
        assert found == pytest.approx(changed, rel=1e-6)
        assert made.describe()["solver"] == made.settings
    for wrong in ({"no such": 1}, *({name: -1} for name in numbers)):
        with pytest.raises(IntegGymError, match=r"solver"):
            _settings(engine, integrator, **wrong)


@pytest.mark.parametrize("integrator", ["implicit_euler", "implicit_midpoint"])
def test_one_iteration_is_another_map_in_every_form(integrator):
    """Single, vector, compiled and traced environments agree, and say that it has not converged."""
    arguments = {
        "integrator": integrator, "dt": 0.2, "damping": 0.5, "max_torque": 5.0,
        "solver": {"iterations": 1, "tolerance": 1e-12},
    }  # fmt: skip
    env = gym.make(PENDULUM, **arguments)
    env.reset(seed=3)
    plain_arguments = {**arguments, "solver": None}
    plain = gym.make(PENDULUM, **plain_arguments)
    plain.reset(seed=3)
    mode = "vector_entry_point"
    lanes, plain_lanes = (
        [
            gym.make_vec(PENDULUM, 2, vectorization_mode=mode, compiled=c, **given)
            for c in (False, True)
        ]
        for given in (arguments, plain_arguments)
    )
    for one in (*lanes, *plain_lanes):
        one.reset(seed=[3, 4])
    for step in range(5):
        action = np.array([(-1.0) ** step * 5.0])
        for single, vectors, status in (
            (env, lanes, "not_converged"), (plain, plain_lanes, "ok"),
        ):  # fmt: skip
            *_, info = single.step(action)
            assert info["solver_status"] == status
            for one in vectors:
                one.step(np.array([action, action]))
                np.testing.assert_array_equal(one.unwrapped.state[0], single.unwrapped.state)
    assert np.abs(env.unwrapped.state - plain.unwrapped.state).max() > 1e-6


def test_darts_other_solver_acts_on_joint_limits():
    needs("dart")
    arguments = {"engine": "dart", "integrator": "semi_implicit_euler", "contact": "engine"}
    ends = []
    for changes in ({}, {"epsilonForDivision": 1e3}, {"boxedLcpSolver": "PgsBoxedLcpSolver"}):
        solver = {"boxedLcpSolver": "PgsBoxedLcpSolver", **changes} if changes else None
        env = gym.make("IntegCartPoleSwingUp-v0", dt=0.02, solver=solver, **arguments)
        env.reset(seed=0)
        for _ in range(100):
            env.step(np.array([10.0]))
        ends.append(env.unwrapped.state[0])
    assert ends[0] == ends[2] < ends[1]
    with pytest.raises(IntegGymError, match="Valid choices: DantzigBoxedLcpSolver"):
        _settings("dart", "semi_implicit_euler", boxedLcpSolver="Lemke")


def test_traced_programs_of_other_settings_are_others():
    import jax

    ends = []
    with jax.enable_x64(True):
        for solver in (None, {"iterations": 1, "tolerance": 1e-12}):
            given = {"integrator": "implicit_euler", "dt": 0.2, "damping": 0.5, "solver": solver}
            single = gym.make(PENDULUM, **given)
            single.reset(seed=3)
            env = integ_gym.functional.make(PENDULUM, dtype="float64", **given)
            state = env.initial_from(single.unwrapped.state, jax.random.key(0))
            step = jax.jit(env.transition)
            for k in range(5):
                own = single.step(np.array([2.0]))[0]
                state = step(state, np.array([2.0]), jax.random.key(k))
            ends.append(np.asarray(env.observation(state, None)))
            np.testing.assert_allclose(ends[-1], own, rtol=1e-6, atol=1e-6)
    assert np.abs(ends[0] - ends[1]).max() > 1e-6


def test_damping_of_euler_is_explicit_where_that_is_asked_for():
    needs("mujoco")
    found = numerics.fingerprint("mujoco", "Euler", "pendulum", (("eulerdamp", False),))
    assert found.map == "symplectic_euler"
    assert numerics.fingerprint("mujoco", "Euler").map == "symplectic_euler_implicit_damping"
    assert _engine("mujoco", "Euler", eulerdamp=False).describe()["map"] == "symplectic_euler"


OTHERS = {
    "iterations": 3, "ls_iterations": 7, "noslip_iterations": 2, "tolerance": 1e-4,
    "ls_tolerance": 0.1, "noslip_tolerance": 1e-3, "impratio": 10.0, "solver": "CG",
    "cone": "elliptic", "jacobian": "dense", "eulerdamp": False, "refsafe": False,
    "warmstart": False,
}  # fmt: skip


def test_what_is_written_is_read_back():
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    own = read_solver(mujoco, model)
    assert set(own) == set(SETTINGS) == set(OTHERS)
    for name, value in OTHERS.items():
        assert own[name] != value
        write_solver(mujoco, model, {name: value})
        assert read_solver(mujoco, model) == {**own, name: value}
        write_solver(mujoco, model, {name: own[name]})
    assert read_solver(mujoco, model) == own


@pytest.mark.parametrize(
    ("settings", "about"),
    [
        ({"iteration": 1}, "iterations"),
        ({"iterations": 1.5}, "whole"),
        ({"tolerance": -1.0}, "at least 0"),
        ({"impratio": True}, "at least 0"),
        ({"cone": "round"}, "elliptic"),
        ({"refsafe": 1}, "true or false"),
    ],
)
def test_a_wrong_setting_is_refused(settings, about):
    with pytest.raises(ValueError, match=about):
        integ_gym.rediscretize(gym.make("Hopper-v5"), solver=settings)


def test_a_task_is_solved_and_recorded_with_its_settings():
    stock = gym.make("Hopper-v5")
    model = stock.unwrapped.model
    model.opt.iterations, model.opt.cone = 1, 1
    env = integ_gym.rediscretize(
        gym.make("Hopper-v5"), solver={"iterations": 1, "cone": "elliptic"}
    )
    plain = integ_gym.rediscretize(gym.make("Hopper-v5"))
    ends = []
    for one in (stock, env, plain):
        one.reset(seed=1)
        for _ in range(20):
            seen, *_ = one.step(np.full(3, 0.3, np.float32))
        ends.append(seen)
    assert (ends[0] == ends[1]).all()
    assert (ends[1] != ends[2]).any()
    solver = env.setup.arguments()["solver"]
    assert (solver["iterations"], solver["cone"], solver["solver"]) == (1, "elliptic", "Newton")
    assert env.setup.engine.solver()["solver_cap"] == 1
