"""The functional environment beside the vector one, under the same starts, draws and actions."""

from __future__ import annotations

import gymnasium as gym
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.vector import AutoresetMode

from integ_gym.envs import functional
from integ_gym.envs.integrators.newton import TOLERANCE
from integ_gym.envs.tasks.interface import to_public_order
from integ_gym.envs.transition import STATUS_NAMES

ROUNDED = {"solver_iterations": 3, "solver_residual": TOLERANCE}
"""How far the worlds may differ: rounding decides whether an iteration below the solver's tolerance
still improves, and so whether it is the last, or where in a kink the next begins."""


def vector_of(env_id, lanes, **arguments):
    """The vector environment that resets as it is told."""
    return gym.make_vec(
        env_id, num_envs=lanes, vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.DISABLED.value, **arguments,
    ).unwrapped  # fmt: skip


def programs_serving(env, changes, alone, lanes=6, rtol=1e-6, atol=1e-6):
    """How many programs step an environment under changed parameters, as ``alone(changed)`` does.

    ``alone`` gives a transition of (state, action, key).
    """
    compiled = []

    @jax.jit
    def advance(state, action, params):
        compiled.append(1)
        return env.transition(state, action, jax.random.key(0), params)

    state = env.initial(jax.random.key(0), lanes=(lanes,))
    action = np.ones((lanes, 1), dtype=np.float32)
    for changed in changes:
        after = advance(state, action, env.params(**changed))
        expected = alone(changed)(state, action, jax.random.key(0))
        np.testing.assert_allclose(after.env.v, expected.env.v, rtol=rtol, atol=atol)
        assert after.env.v[0].dtype == np.float32
    return len(compiled)


def compare(env_id, arguments, steps=25, lanes=6):
    """Step both in float64 and begin ended lanes as the functional one draws; counts these."""
    with jax.enable_x64(True):
        return _compare(env_id, arguments, steps, lanes)


def _compare(env_id, arguments, steps, lanes):
    vector = vector_of(env_id, lanes, **arguments)
    env = functional.make(env_id, dtype="float64", **arguments)
    advance, initial = (
        jax.jit(env.transition),
        jax.jit(lambda key: env.initial(key, None, (lanes,))),
    )
    rng, ends, space = np.random.default_rng(0), 0, vector.single_action_space
    state = initial(jax.random.key(0))
    begin_lanes(vector, state, np.ones(lanes, dtype=bool))
    for step in range(steps):
        if isinstance(space, gym.spaces.Discrete):
            action = rng.integers(space.n, size=lanes)
        else:
            beyond, shape = 0.25 * (space.high - space.low), (lanes, *space.shape)
            action = rng.uniform(space.low - beyond, space.high + beyond, shape).astype(np.float32)
            action[0, 0] = np.nan
        observation, reward, terminated, truncated, info = vector.step(action)
        state = advance(state, action, jax.random.key(step), env.default_params)
        _assert_same(state.env, vector._state)
        np.testing.assert_allclose(env.observation(state), observation, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(env.reward(state, action, state), reward, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(env.terminal(state), terminated)
        np.testing.assert_array_equal(env.truncated(state), truncated)
        told = env.state_info(state)
        assert list(told) == [name for name in info if not name.startswith("_")]
        for name in set(told) - {"solver_status"}:
            atol = ROUNDED.get(name, 1e-12)
            np.testing.assert_allclose(told[name], info[name], 1e-9, atol, err_msg=name)
        status = [STATUS_NAMES[code] for code in np.asarray(told["solver_status"])]
        assert status == info["solver_status"].tolist()
        done = terminated | truncated
        ends += int(done.sum())
        if done.any():
            begun = initial(jax.random.key(1000 + step))
            state = jax.tree.map(lambda a, b, d=done: jnp.where(d, a, b), begun, state)
            begin_lanes(vector, state, done)
    return ends


def begin_lanes(vector, state, mask):
    """Begin in the vector environment what the functional one has drawn, in some lanes."""
    components = zip(state.env.q, state.env.v, strict=True)
    starts = np.stack([np.asarray(x) for pair in components for x in pair], axis=1)
    options = {"state": to_public_order(vector.setup.task, starts), "reset_mask": mask}
    if len(vector.mixture.setups) > 1:
        options["mixture_index"] = np.asarray(state.member[0])
    vector.reset(seed=0, options=options)


def _assert_same(found, expected):
    for name in expected._fields:
        values = jax.tree.leaves(getattr(expected, name))
        for a, b in zip(jax.tree.leaves(getattr(found, name)), values, strict=True):
            a, b = np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float))
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12, err_msg=name)
