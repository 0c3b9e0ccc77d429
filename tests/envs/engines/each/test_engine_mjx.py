"""MJX: float64 by itself, one program for all mechanisms, stops that weigh what MuJoCo's do."""

import ctypes
import json
from functools import partial

import numpy as np
import pytest
from engine_cases import needs, setup_of
from engine_checks import new_setup
from recording import recorded

import integ_gym
from integ_gym.envs import numerics
from integ_gym.envs.engines import warp as mujoco_warp
from integ_gym.envs.engines.newton import FEATHERSTONE
from integ_gym.envs.ops.ops import ARRAY, SCALAR
from integ_gym.evidence.replaying import replay

ENGINE = ("mjx", "Euler")
PENDULUM = "IntegPendulum-v0"
STOPPED = {"env_id": "IntegCartPoleSwingUp-v0", "contact": "engine", "dt": 0.001}


@pytest.fixture
def program():
    """The module of MJX's functions."""
    needs("mjx")
    from integ_gym.envs.engines import mjx_program as _mjx_program

    return _mjx_program


def test_one_program_serves_all_mechanisms_of_the_same_joints(program):
    one = setup_of(*ENGINE, "IntegCartPole-v0").engine
    other = setup_of(*ENGINE, "IntegCartPole-v0", dt=0.1, cart_mass=3.0, length=0.2).engine
    assert one._program is other._program
    assert one._program is not setup_of(*ENGINE, "IntegPendulum-v0").engine._program


def test_jax_is_left_as_it_was(program):
    import jax

    before = {name: jax.config.values[name] for name in jax.config.values}
    setup = new_setup(*ENGINE, "IntegPendulum-v0", dt=0.03)
    setup.engine.run(1)(0.1, 0.2, 0.3)
    assert before == {name: jax.config.values[name] for name in jax.config.values}
    assert jax.numpy.zeros(1).dtype == "float32"


def test_lanes_are_single_environments_to_the_last_bit(program):
    """More of them than one call takes; a lane that is astray is lost alone."""
    engine = setup_of(*ENGINE, "IntegCartPole-v0").engine
    count = 2 * program.LANES + 3
    starts = np.random.default_rng(1).uniform(-3.0, 3.0, (6, count))
    starts[1, 5], starts[2, 7] = np.nan, 1e30
    q, v, force = tuple(starts[:2]), tuple(starts[2:4]), tuple(starts[4:])
    many = engine.travel(None, q, v, force, 2)
    for lane in (0, 4, 5, 6, 7, 8, count - 1):
        single = engine.run(2)(*starts[:, lane])
        got = [x[lane] for x in (*many[0], *many[1])]
        assert np.isnan(got).all() if lane in (5, 7) else got == list(single)


@pytest.mark.parametrize("cart_mass", [0.5, 5.0])
def test_its_stops_are_those_of_mujoco(program, cart_mass):
    """Also where the mechanism is another than the one that a program is made for."""
    needs("mujoco")
    told = []
    for engine in ("mjx", "mujoco"):
        setup = new_setup(engine, "Euler", **STOPPED, cart_mass=cart_mass)
        q, v, force = (2.41, 0.3), (1.0, 0.5), (0.0, 0.0)
        end = setup.engine.travel(SCALAR, q, v, force, 1)
        told.append((np.array([*end[0], *end[1]]), setup.engine.describe()["stops"]))
    np.testing.assert_allclose(told[0][0], told[1][0], rtol=1e-9)
    assert told[0][1] == told[1][1]


def test_a_float_width_of_32_is_a_setting_that_is_recorded_and_played_again(program, tmp_path):
    """Every number is one of float32, singly and in lanes; the default is 64."""
    narrow = {"solver": {"float_width": 32}}
    single, double = (new_setup(*ENGINE, PENDULUM, **given).engine for given in (narrow, {}))
    for engine, width in ((single, 32), (double, 64)):
        assert (engine.settings["float_width"], engine.describe()["width"]) == (width, width)
    starts = np.random.default_rng(1).uniform(-3.0, 3.0, (3, 5))
    one, other = (
        engine.travel(None, (starts[0],), (starts[1],), (starts[2],), 2)
        for engine in (single, double)
    )
    for narrowed, wide in zip((one[0][0], one[1][0]), (other[0][0], other[1][0]), strict=True):
        assert narrowed.dtype == np.float64
        assert (narrowed == narrowed.astype(np.float32)).all()
        assert (wide != wide.astype(np.float32)).any()
        np.testing.assert_allclose(narrowed, wide, atol=1e-5)
    assert single.run(2)(*starts[:, 3]) == (one[0][0][3], one[1][0][3])
    found = numerics.fingerprint(*ENGINE, "pendulum", (("float_width", 32),))
    assert (found.width, found.map) == (32, "symplectic_euler_implicit_damping")
    chosen = {"engine": "mjx", "integrator": "Euler", "dt": 0.02, **narrow}
    store = recorded(tmp_path, range(2), duration=0.2, **chosen)
    for record in store.records():
        told = json.loads(record.fields["engine_description"])
        assert record.fields["float_width"] == told["width"] == told["fingerprint"]["width"] == 32
        assert told["solver"]["float_width"] == 32
    done = replay(list(store.named_records()), exact=True).settle()
    assert (done.findings, done.exact, done.skipped) == ([], 2, {})


def test_a_float_width_that_cannot_be_is_refused(program):
    import jax

    with pytest.raises(ValueError, match=r"`solver\.float_width` must be 32 or 64, got 16"):
        new_setup(*ENGINE, PENDULUM, solver={"float_width": 16})
    given = {"engine": "mjx", "integrator": "Euler", "solver": {"float_width": 32}}
    with jax.enable_x64(True):
        env = integ_gym.functional.make(PENDULUM, dtype="float64", **given)
        with pytest.raises(ValueError, match="give it `dtype`='float32'"):
            env.initial(jax.random.key(0))
    env = integ_gym.functional.make(PENDULUM, **given)
    assert env.initial(jax.random.key(0)).env.q[0].dtype == "float32"


HELD = {"env_id": "IntegCartPoleSwingUp-v0", "contact": "engine", "dt": 0.001}


@pytest.mark.parametrize(
    ("engine", "integrator"), [("mujoco_warp", "Euler"), ("newton", FEATHERSTONE)]
)
def test_all_lanes_are_moved_by_one_replay(engine, integrator, monkeypatch):
    made = setup_of(engine, integrator, "IntegCartPole-v0").engine
    rng = np.random.default_rng(1)
    starts = rng.uniform(-3.0, 3.0, (6, 40)).astype(np.float32).astype(np.float64)
    starts[1, 5], starts[2, 7] = np.nan, 1e30
    arguments = tuple(starts[:2]), tuple(starts[2:4]), tuple(starts[4:])
    many = made.travel(None, *arguments, 1)
    for lane in (0, 4, 5, 6, 7, 8, 39):
        single = made.run(1)(*starts[:, lane])
        got = [x[lane] for x in (*many[0], *many[1])]
        assert np.isnan(got).all() if lane in (5, 7) else got == list(single)
    replay, calls = made._warp.capture_launch, []
    monkeypatch.setattr(made._warp, "capture_launch", lambda g: calls.append(g) or replay(g))
    made.travel(None, *arguments, 3)
    assert len(calls) == 3


def _stopped_at_one(engine, monkeypatch):
    """Let the engine's constraint solver take one iteration at most."""
    if engine == "mujoco_warp":
        ours = mujoco_warp.mjcf
        cut = '<option iterations="1" '
        monkeypatch.setattr(
            mujoco_warp, "mjcf", lambda *given: ours(*given).replace("<option ", cut)
        )
    else:
        import newton

        theirs = newton.solvers.SolverMuJoCo
        monkeypatch.setattr(newton.solvers, "SolverMuJoCo", partial(theirs, iterations=1))


@pytest.mark.parametrize(
    ("engine", "integrator"), [("mujoco_warp", "Euler"), ("newton", "mujoco_euler")]
)
def test_warps_solver_that_is_stopped_at_its_cap_has_not_converged(
    engine, integrator, monkeypatch, capfd
):
    """And prints nothing, also where it would have gone on."""
    needs(engine)
    _stopped_at_one(engine, monkeypatch)
    cut = new_setup(engine, integrator, **HELD).engine
    assert cut.solver()["solver_cap"] == 1
    q, v, control = (2.41, 0.3), (1.0, 5.0), (((0.0,), 1),)
    motion = cut.advance(SCALAR, q, v, control, None)
    assert (motion.iterations, motion.converged) == (1, False)
    lanes = [np.array([x, x, np.nan]) for x in (*q, *v)]
    many = cut.advance(ARRAY, tuple(lanes[:2]), tuple(lanes[2:]), control, None)
    assert many.iterations[:2].tolist() == [1.0, 1.0]
    assert not many.converged.any()
    fast = cut.advance(SCALAR, (2.6, 0.3), (500.0, -800.0), (((1e5,), 1),), None)
    assert (fast.iterations, fast.converged) == (1, False)
    ctypes.CDLL(None).fflush(None)
    assert capfd.readouterr() == ("", "")
