"""What training takes: measurements, most of them in a worker process of one thread."""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.evidence.labels import EpisodeContext
from integ_gym.support.processes import Progress, peak_memory
from integ_gym.train.config import TrainingEvidence
from integ_gym.train.fleet import training as fleet
from integ_gym.train.fleet import worker as fleet_worker
from integ_gym.train.fleet.learning import permutations, update
from integ_gym.train.ppo import PPOConfig, train_run

MATRICES, SIDE, PRODUCTS = 32, 64, 500
"""For the measured peak: so many square matrices, and products of each."""

ROLLOUTS = 5
"""Of which the first compiles and the others are timed."""

REPEATS = 5


def fleet_seconds(configs: Sequence[PPOConfig], workers: int, cache: Path) -> dict[str, float]:
    """Train as a panel does: processes started, programs compiled, evidence and files written.

    Args:
        configs: of the runs.
        workers: processes.
        cache: folder of the programs that runs before have compiled.

    Returns:
        Wall time in s, and the most memory that a worker took, in MiB (this process's at least).
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        start = time.perf_counter()
        fleet.train_fleet(
            configs,
            [folder / f"seed{config.seed}" for config in configs],
            evidence=[_evidence_of(config, folder) for config in configs],
            progress=False,
            workers=workers,
            cache_dir=cache,
        )
        seconds = time.perf_counter() - start
    largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return {"seconds": seconds, "worker_mib": largest / 1024.0}


def sb3_seconds(config: PPOConfig, processes: int, runs: int) -> float:
    """Wall time of ``runs`` policies of stable-baselines3 in each of some processes, s.

    The clock starts when all processes have been started and have trained for one rollout.
    """
    with Progress().pool(processes) as pool:
        short = replace(config, total_steps=config.rollout, n_epochs=1)
        list(pool.map(_train_with_sb3, [[short]] * processes))
        tasks = [
            [replace(config, seed=process * runs + run) for run in range(runs)]
            for process in range(processes)
        ]
        start = time.perf_counter()
        list(pool.map(_train_with_sb3, tasks))
        return time.perf_counter() - start


def in_one_process(measure: Callable[..., Any], *arguments: Any) -> Any:
    """``measure`` in a fresh process, set up as a worker of the fleet is."""
    prepare = partial(fleet_worker.prepare_worker, str(fleet_worker.default_cache_dir()), "cpu")
    with Progress().pool(1, prepare) as pool:
        return pool.submit(measure, *arguments).result()


def rollout_cost(configs: Sequence[PPOConfig], evidence: bool = True) -> dict[str, float]:
    """One rollout of all runs with what is learned from it, compiled before.

    Returns:
        Wall and processor time in s, and the most memory of the process in MiB.
    """
    runs = [replace(config, total_steps=ROLLOUTS * config.rollout) for config in configs]
    times: list[tuple[float, float]] = []

    def note(steps: int) -> None:
        times.append((time.perf_counter(), time.process_time()))

    with tempfile.TemporaryDirectory() as name:
        recordings = [_evidence_of(config, Path(name)) for config in runs] if evidence else None
        fleet.train_chunk(runs, recordings, note)
    wall, cpu = np.diff(times, axis=0)[1:].min(axis=0)
    mib = (peak_memory() or 0) / 2**20
    return {"wall": float(wall), "cpu": float(cpu), "mib": mib}


def relative_cost(configs: Sequence[PPOConfig], baseline: Sequence[PPOConfig]) -> dict[str, float]:
    """Cost of some runs beside that of others, measured before and after them.

    Returns:
        What `rollout_cost` tells of the runs, and the ratio of their processor time to the mean of
        the baseline's, which the machine's own changes of speed hardly touch.
    """
    before = rollout_cost(baseline)
    found = rollout_cost(configs)
    after = rollout_cost(baseline)
    return {**found, "ratio": 2.0 * found["cpu"] / (before["cpu"] + after["cpu"])}


def part_seconds(configs: Sequence[PPOConfig]) -> dict[str, float]:
    """Processor time of the parts of one rollout of all runs, s."""
    trainer = fleet._Trainer(fleet.kind_of(configs[0]), configs, None)
    learner, knobs, params = trainer._new(), trainer._knobs(), trainer._params
    program = trainer._program
    parts: dict[str, float] = {}

    def part(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        result, parts[name] = _compiled(function, *arguments)
        return result

    _, steps = part("acting in the environments", program._collect, learner, learner.keys, params)
    _, outcome, *observed = part("their transitions again", program._again, steps, params)
    given = learner.stack, knobs, steps, outcome, tuple(observed)
    batch = part("values and advantages", program._batch, *given)
    orders = part(
        "random orders of the samples, for minibatches",
        partial(permutations, program.algorithm),
        learner.keys,
    )
    given = learner.stack, learner.adam, batch, orders, knobs, knobs.learning_rate
    learn = partial(update, program.algorithm)
    part("updates", lambda *given: program._each(learn, given), *given)
    return parts


def acting_seconds(configs: Sequence[PPOConfig]) -> float:
    """Processor time of acting in the environments for one rollout of all runs, s."""
    trainer = fleet._Trainer(fleet.kind_of(configs[0]), configs, None)
    learner = trainer._new()
    given = learner, learner.keys, trainer._params
    seconds: float = _compiled(trainer._program._collect, *given)[1]
    return seconds


def _compiled(function: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """What a compiled function gives, and the processor time that it takes, s."""
    from integ_gym.envs.ops.jax_ops import jax

    compiled = jax.jit(function)
    result = jax.block_until_ready(compiled(*arguments))
    return result, _fastest(lambda: jax.block_until_ready(compiled(*arguments)))


def small_matrix_peak() -> float:
    """Floating-point operations per second of one core in products of small float32 matrices."""
    from integ_gym.envs.ops.jax_ops import jax, jnp

    left, right = jax.random.normal(jax.random.key(0), (2, MATRICES, SIDE, SIDE))

    @jax.jit
    def multiply(left: Any, right: Any) -> Any:
        scaled = left / SIDE
        return jax.lax.scan(lambda x, _: (scaled @ x, None), right, None, length=PRODUCTS)[0]

    jax.block_until_ready(multiply(left, jnp.asarray(right)))
    seconds = _fastest(lambda: jax.block_until_ready(multiply(left, right)))
    return 2.0 * SIDE**3 * MATRICES * PRODUCTS / seconds


def update_flops(config: PPOConfig, sizes: Sequence[int]) -> float:
    """Operations in the matrix products of all updates of one rollout.

    Args:
        config: the run.
        sizes: of observation, hidden layers and the actor's outputs.
    """
    layers = [a * b for a, b in pairwise(sizes)]
    forward = backward_weights = sum(layers)
    backward = sum(layers[1:])
    decisions = config.rollout * config.n_epochs
    return 2.0 * 2.0 * (forward + backward_weights + backward) * decisions


def _fastest(run: Callable[[], Any]) -> float:
    """Least processor time of some runs, s."""
    found = []
    for _ in range(REPEATS):
        start = time.process_time()
        run()
        found.append(time.process_time() - start)
    return min(found)


def _evidence_of(config: PPOConfig, folder: Path) -> TrainingEvidence:
    """Where a run's training episodes go, every 50th with its trace."""
    context = EpisodeContext("cost", f"seed{config.seed}", phase="training", trace_every=50)
    return TrainingEvidence(folder / "evidence", f"seed{config.seed}", context)


def _train_with_sb3(configs: Sequence[PPOConfig]) -> None:
    for config in configs:
        with tempfile.TemporaryDirectory() as name:
            recordings = _evidence_of(config, Path(name))
            train_run(config, Path(name) / "out", recordings)
