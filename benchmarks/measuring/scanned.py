"""Rates of compiled rollouts: one process per core, one thread each.

Every step has observation, a linear policy on it, reward and automatic reset, and in ours the
energy ledger; compiling is not counted. XLA uses about one core per device, so all cores need
several processes.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.envs import functional
from integ_gym.envs.ops.jax_ops import jax, jnp
from integ_gym.support.processes import Progress, cores
from integ_gym.train.fleet.worker import default_cache_dir, prepare_worker

GAINS = {
    "IntegPendulum-v0": (0.0, -6.0, -1.5),
    "Pendulum-v1": (0.0, -6.0, -1.5),
    "IntegCartPole-v0": (0.3, 0.5, 8.0, 1.5),
    "CartPole-v1": (0.3, 0.5, 8.0, 1.5),
}
"""Feedback on the observation that keeps episodes going."""

REPEATS = 3

Case = tuple[str, str | None]
"""Id of an environment and name of an integrator; None: gymnax's environment."""

_barrier: Any = None
"""In a worker: where all wait for each other."""


def scanned_rates(cases: Sequence[Case], lanes: int, steps: int) -> list[dict[str, float] | None]:
    """Steps per second of all processes together, and per second of processor time in one.

    Args:
        cases: what to measure.
        lanes: environments per process.
        steps: of one rollout.

    Returns:
        One entry per case; None where gymnax is asked for and not installed.
    """
    workers = cores()
    barrier = multiprocessing.get_context("spawn").Barrier(workers)
    with Progress().pool(workers, partial(_prepare, barrier, default_cache_dir())) as pool:
        return [
            _joined(list(pool.map(_rate, *zip(*[(case, lanes, steps)] * workers, strict=True))))
            for case in cases
        ]


def _joined(found: list[dict[str, float] | None]) -> dict[str, float] | None:
    measured = [one for one in found if one is not None]
    if not measured:
        return None
    return {
        "steps_per_second": sum(one["wall"] for one in measured),
        "steps_per_core_second": float(np.mean([one["cpu"] for one in measured])),
    }


def _prepare(barrier: Any, cache_dir: Path, number: int) -> None:
    global _barrier
    _barrier = barrier
    prepare_worker(str(cache_dir), "cpu", number)


def _rate(case: Case, lanes: int, steps: int) -> dict[str, float] | None:
    """The best of some rollouts in this process, while all others are at it too."""
    env_id, integrator = case
    try:
        if integrator is None:
            rollout = _gymnax_rollout(env_id, lanes, steps)
        else:
            rollout = _our_rollout(env_id, integrator, lanes, steps)
    except ModuleNotFoundError:
        return None
    jax.block_until_ready(rollout(jax.random.key(0)))
    _barrier.wait()
    best = {"wall": 0.0, "cpu": 0.0}
    for number in range(REPEATS):
        wall, cpu = time.perf_counter(), time.process_time()
        jax.block_until_ready(rollout(jax.random.key(number)))
        best["wall"] = max(best["wall"], lanes * steps / (time.perf_counter() - wall))
        best["cpu"] = max(best["cpu"], lanes * steps / (time.process_time() - cpu))
    return best


def _our_rollout(env_id: str, integrator: str, lanes: int, steps: int) -> Callable[[Any], Any]:
    """From a key to the mean return and ledger of a lane, and the number of episodes ended."""
    env = functional.make(env_id, integrator=integrator)
    gains = np.array(GAINS[env_id], np.float32)
    discrete = env.setup.task.discrete is not None

    def step(carry: Any, key: Any, params: Any) -> Any:
        state, total = carry
        control = env.observation(state, params=params) @ gains
        action = (control > 0).astype(jnp.int32) if discrete else control[:, None]
        state, seen = env.step(state, action, key, params)
        ledger = sum(seen.info[n] for n in ("actuator_work", "dissipated", "energy_residual"))
        return (state, total + seen.reward + ledger), seen.truncated.sum()

    @jax.jit
    def rollout(key: Any, params: Any) -> Any:
        first = (env.initial(key, params, (lanes,)), jnp.zeros(lanes))
        keys = jax.random.split(key, steps)
        (_, total), ended = jax.lax.scan(lambda c, k: step(c, k, params), first, keys)
        return total.mean(), ended.sum()

    return lambda key: rollout(key, env.default_params)


def _gymnax_rollout(env_id: str, lanes: int, steps: int) -> Callable[[Any], Any]:
    """The same with gymnax's environment; without an integrator to choose and without a ledger."""
    import gymnax

    env, params = gymnax.make(env_id)
    gains = np.array(GAINS[env_id], np.float32)
    discrete = env_id == "CartPole-v1"

    def step(carry: Any, key: Any) -> Any:
        observation, state, total = carry
        control = observation @ gains
        action = (control > 0).astype(jnp.int32) if discrete else control[:, None]
        keys = jax.random.split(key, lanes)
        observation, state, reward, done, _ = jax.vmap(env.step, (0, 0, 0, None))(
            keys, state, action, params
        )
        return (observation, state, total + reward.reshape(lanes)), done.sum()

    @jax.jit
    def rollout(key: Any) -> Any:
        observation, state = jax.vmap(env.reset, (0, None))(jax.random.split(key, lanes), params)
        first = (observation, state, jnp.zeros(lanes))
        (_, _, total), ended = jax.lax.scan(step, first, jax.random.split(key, steps))
        return total.mean(), ended.sum()

    return rollout
