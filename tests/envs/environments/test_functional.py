"""The functional environment is the vector environment, as pure functions."""

from functools import partial

import gymnasium as gym
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from engine_cases import FOREIGN, needs
from functional_checks import compare, programs_serving
from gymnasium.experimental.functional import FuncEnv
from motions import ALL
from pairing import pairs

from integ_gym.envs import functional
from integ_gym.envs.registries import ENGINES, ENVIRONMENTS

LANES = 6
VARIANTS = {
    "plain": {},
    "substeps": {"dt": 0.01, "control_period": 0.03},
    "latency": {"dt": 0.01, "control_period": 0.03, "action_latency": 0.04, "fallback": "zero"},
    "sensor": {"dt": 0.01, "control_period": 0.02, "sensor_period": 0.03},
    "speed limit": {"max_speed": 3.5, "damping": 0.1},
    "short": {"duration": 0.2},
    "diverging": {"integrator": "explicit_euler", "dt": 0.5, "damping": 50.0},
}
STOPPED = {"joint_limit": 1.0, "friction": 0.1, "start": "uniform"}


@pytest.mark.parametrize(("integrator", "env_id"), pairs(ALL, ENVIRONMENTS, strength=1))
def test_equals_the_vector_environment(env_id, integrator):
    """Every integrator and every environment once.

    An integrator meets plants through one interface, in all three worlds alike: that is
    `test_worlds.py`. Here it is asked whether the environment around them is the same.
    """
    compare(env_id, {"integrator": integrator}, steps=12)


@pytest.mark.parametrize(("variant", "env_id"), pairs(VARIANTS, ENVIRONMENTS, strength=1))
def test_equals_the_vector_environment_in_every_variant(env_id, variant):
    """Every variant and every environment once, because timing knows no task; else as above."""
    ends = compare(env_id, VARIANTS[variant])
    assert ends > 0 or variant not in ("short", "diverging")


def test_equals_the_vector_environment_at_way_points():
    compare("IntegQuadrotor-v0", {"way_point_period": 0.1})


@pytest.mark.parametrize("integrator", ["rk4", "implicit_euler"])
def test_equals_the_vector_environment_in_contact(integrator):
    compare("IntegPendulum-v0", {"integrator": integrator, "dt": 0.01, **STOPPED})


ENGINES_IN_JAX = [
    (env_id, engine, integrator)
    for engine in FOREIGN
    if (owner := ENGINES.load(engine)).batched
    for env_id, integrator in zip(
        ("IntegCartPoleSwingUp-v0", "IntegPendulum-v0"), list(owner.maps)[::2], strict=False
    )
]


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "engine", "integrator"), ENGINES_IN_JAX)
def test_an_engine_in_jax_equals_its_vector_environment(env_id, engine, integrator):
    needs(engine)
    arguments = {
        "engine": engine, "integrator": integrator, "damping": 0.1, **VARIANTS["latency"],
        **VARIANTS["sensor"],
    }  # fmt: skip
    compare(env_id, arguments)


def test_automatic_reset():
    env = functional.make("IntegElasticPendulum-v0", duration=0.1)
    horizon = int(env.default_params.horizon)
    step = jax.jit(env.step)
    state = env.initial(jax.random.key(1), lanes=(LANES,))
    action = np.zeros((LANES, *env.action_space.shape), dtype=np.int32)
    for count in range(horizon):
        state, told = step(state, action, jax.random.key(count), env.default_params)
    assert told.truncated.all()
    assert not told.terminated.any()
    assert (state.env.steps == 0).all()
    assert not state.outcome.truncated.any()
    np.testing.assert_array_equal(env.observation(state), told.observation)
    assert not np.array_equal(told.observation, told.final_observation)
    np.testing.assert_allclose(told.info["time"], 0.1, rtol=1e-6)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_starts_fill_the_start_range(env_id):
    env = functional.make(env_id)
    state = env.initial(jax.random.key(0), lanes=(4000,))
    low, high = functional.start_range(env.setup)
    values = np.stack([x for pair in zip(state.env.q, state.env.v, strict=True) for x in pair])
    vector = gym.make_vec(env_id, num_envs=3000)
    drawn = vector.reset(seed=0) and vector.unwrapped.state
    for mine, theirs, a, b in zip(values, drawn.T, low, high, strict=True):
        assert mine.min() >= a - 1e-6
        assert mine.max() <= b + 1e-6
        np.testing.assert_allclose(
            np.quantile(mine, [0.0, 0.25, 0.5, 0.75, 1.0]),
            np.quantile(theirs, [0.0, 0.25, 0.5, 0.75, 1.0]),
            atol=0.05 * (b - a),
        )


def test_one_program_serves_all_steps_and_plants():
    env = functional.make("IntegPendulum-v0", integrator="rk4", control_period=0.06, dt=0.06)

    def alone(changed):
        return functional.make("IntegPendulum-v0", **{**env._arguments, **changed}).transition

    changes = {}, {"dt": 0.03}, {"dt": 0.01, "mass": 2.0}, {"start": "hanging"}
    assert programs_serving(env, changes, alone) == 1


@pytest.mark.parametrize(
    ("integrator", "native"),
    [("Euler", "symplectic_euler"), pytest.param("RK4", "rk4", marks=pytest.mark.slow)],
)
def test_one_program_of_mjx_serves_all_steps_and_plants(integrator, native):
    """In float32, beside the engine's own in float64; without damping its integrators are ours."""
    needs("mjx")
    arguments = {"control_period": 0.06, "dt": 0.06}
    env = functional.make("IntegPendulum-v0", engine="mjx", integrator=integrator, **arguments)
    own = functional.make("IntegPendulum-v0", integrator=native, **arguments)

    def alone(changed):
        return partial(jax.jit(own.transition), params=own.params(**changed))

    changes = {}, {"dt": 0.03}, {"dt": 0.01, "mass": 2.0, "length": 0.3, "gravity": 3.0}
    assert programs_serving(env, changes, alone, rtol=1e-5, atol=1e-5) == 1


def test_single_environment_and_vmap_agree_with_a_batch():
    env = functional.make("IntegCartPole-v0", integrator="implicit_midpoint")
    starts = np.random.default_rng(0).uniform(-0.05, 0.05, (LANES, 4))
    actions = np.arange(LANES) % 2
    key = jax.random.key(0)

    def advance(start, action):
        return env.transition(env.initial_from(start, key), action, key)

    batch = jax.jit(advance)(starts, actions)
    mapped = jax.jit(jax.vmap(advance))(starts, actions)
    for a, b in zip(jax.tree.leaves(batch), jax.tree.leaves(mapped), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-7)
    single = jax.jit(advance)(starts[2], actions[2])
    assert single.env.q[0].shape == ()
    np.testing.assert_allclose(single.env.v[1], batch.env.v[1][2], rtol=1e-6)


def test_noise_is_drawn_once_per_sample():
    env = functional.make(
        "IntegPendulum-v0", dt=0.01, control_period=0.01, sensor_period=0.03, observation_noise=0.1
    )
    state = env.initial(jax.random.key(0), lanes=(2000,))
    advance = jax.jit(env.transition)
    action = np.zeros((2000, 1), dtype=np.float32)
    kept = []
    for count in range(6):
        after = advance(state, action, jax.random.key(count))
        kept.append(np.array_equal(after.noise[0], state.noise[0]))
        assert bool(after.outcome.sampled.all()) != kept[-1]
        state = after
    assert kept == [True, True, False, True, True, False]
    error = env.observation(state)[:, 2] - state.env.sensed_v[0]
    np.testing.assert_allclose(np.std(error), 0.1, rtol=0.1)
    assert np.abs(env.observation(state)[:, :2]).max() <= 1.0


def test_is_gymnasiums_functional_environment():
    env = functional.make("IntegPendulum-v0")
    assert isinstance(env, FuncEnv)
    env.transform(jax.jit)
    state = env.initial(jax.random.key(0))
    after = env.transition(state, jnp.zeros(1), jax.random.key(0))
    assert env.observation_space.contains(np.asarray(env.observation(after)))
    assert env.reward(state, jnp.zeros(1), after) <= 0.0
    assert env.transition_info(state, jnp.zeros(1), after)["time"] == pytest.approx(0.05)


def test_refusals():
    with pytest.raises(ValueError, match=r"does not give its equations .* give IntegAcrobot-v0"):
        functional.make("Pendulum-v1")
    with pytest.raises(ValueError, match="`dtype` must be one of float32, float64"):
        functional.make("IntegPendulum-v0", dtype="float16")
    with pytest.raises(ValueError, match="enable_x64"):
        functional.make("IntegPendulum-v0", dtype="float64")
    with pytest.raises(TypeError, match="unexpected keyword argument 'mas'"):
        functional.make("IntegPendulum-v0", mas=1.0)
    needs("mujoco")
    with pytest.raises(ValueError, match="'native' or 'mjx', got 'mujoco'"):
        functional.make("IntegPendulum-v0", engine="mujoco", integrator="Euler")
    needs("mjx")
    with pytest.raises(ValueError, match="no `contact`='engine'"):
        functional.make(
            "IntegCartPoleSwingUp-v0", engine="mjx", integrator="Euler", contact="engine"
        )
    env = functional.make("IntegPendulum-v0")
    with pytest.raises(ValueError, match="another program"):
        env.params(integrator="rk4")
    with pytest.raises(ValueError, match="another program"):
        env.params(max_speed=8.0)
