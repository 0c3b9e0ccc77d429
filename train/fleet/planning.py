"""Which runs the fleet trains together, in which processes, on cores or GPUs."""

from __future__ import annotations

import math
import os
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np

from integ_gym.envs.ops.jax_ops import jax
from integ_gym.envs.registries import ENGINES
from integ_gym.evidence.episodes import Layout
from integ_gym.support.errors import InputError

from ..ppo import PPOConfig
from .learning import Algorithm
from .worker import GIB_PER_WORKER, Workers

ROWS_AT_ONCE = 1 << 13
"""Rows of finished episodes that are summarised together, for each policy."""


LONGEST = 60.0
"""What a chunk should take at most on one core, s."""

REMEDY = 'use --trainer sb3, or `trainer = "sb3"` in a specification'

MOST_ON_GPU = 512
"""Policies of one chunk on a GPU."""

SHARE_OF_MEMORY = 0.75

PROGRAM_BYTES = 700 << 20
"""What a worker takes before it holds any policy, while it compiles."""

DECISION_BYTES = 1000
"""What one decision of a rollout takes."""

SUMMARY_BYTES = 20
"""What is kept of each decision of a whole run beside traces."""

TRACE_COPIES = 4.0
"""What is kept of traces, and what its writing takes in addition."""

FLOPS = 60e9
"""Floating-point operations per second of one core in an update's matrix products."""

MINIBATCH_SECONDS = 25e-6
"""What an update by one minibatch takes beside its matrix products, s."""

DECISION_SECONDS = 5e-6
"""What a decision takes in its rollout, with its evidence, s."""

SUBSTEP_SECONDS = 0.3e-6
"""What an integration step takes, s."""


@dataclass(frozen=True)
class Kind:
    """What runs of one chunk have in common.

    Attributes:
        structure: of the environment, or of the mixture.
        sizes: of observation and hidden layers.
        algorithm: structure of the learner.
        substeps: integration steps per decision, of each member of a mixture.
        rollouts: in a whole run.
        entries: of an evidence row.
        trace_every: of so many training episodes one keeps its trace until the run is written.
    """

    structure: Hashable
    sizes: tuple[int, ...]
    algorithm: Algorithm
    substeps: tuple[int, ...]
    rollouts: int
    entries: int
    trace_every: int

    @property
    def seconds(self) -> float:
        """What one policy is expected to take on one core, s."""
        algorithm, networks = self.algorithm, 2
        weights = sum(a * b for a, b in pairwise(self.sizes))
        update = algorithm.n_epochs * (
            6 * networks * weights / FLOPS + MINIBATCH_SECONDS / algorithm.batch_size
        )
        decision = DECISION_SECONDS + SUBSTEP_SECONDS * max(self.substeps)
        return self.rollouts * algorithm.rollout * (update + decision)

    @property
    def bytes(self) -> int:
        """What one policy takes."""
        rollout = self.algorithm.rollout
        waiting = 16 * self.entries * max(rollout, ROWS_AT_ONCE)
        traced = TRACE_COPIES * 8 * self.entries / self.trace_every
        history = self.rollouts * rollout * (SUMMARY_BYTES + traced)
        return DECISION_BYTES * rollout + waiting + math.ceil(history)


@dataclass(frozen=True)
class Chunk:
    """Runs that are trained together.

    Attributes:
        kind: what they have in common.
        places: which of the configurations they are.
    """

    kind: Kind
    places: tuple[int, ...]

    @property
    def decisions(self) -> int:
        """Decisions of all its policies."""
        return len(self.places) * self.kind.rollouts * self.kind.algorithm.rollout


def plan(
    configs: Sequence[PPOConfig],
    workers: Workers,
    memory_gib: float | None = None,
) -> list[Chunk]:
    """Split runs into chunks that can be compiled as one, enough of them for all workers.

    Args:
        configs: the runs.
        workers: each of which trains one chunk at a time.
        memory_gib: what all workers together may take, GiB; by default `GIB_PER_WORKER` each, on a
            CPU no more than `SHARE_OF_MEMORY` of the machine's.

    Raises:
        TypeError, ValueError: for a run that the fleet cannot train, or that does not fit.
    """
    groups: dict[Kind, list[int]] = {}
    for place, config in enumerate(configs):
        groups.setdefault(kind_of(config), []).append(place)
    gib = default_gib(workers) if memory_gib is None else memory_gib
    chunks = []
    for kind, places in groups.items():
        _check_traceable(kind, configs[places[0]])
        timely = MOST_ON_GPU if workers.device == "gpu" else max(1, int(LONGEST / kind.seconds))
        most = min(_policies_that_fit(kind, gib, workers.count), timely)
        share = round(workers.count * len(places) / len(configs))
        count = min(len(places), max(share, math.ceil(len(places) / most)))
        chunks += [Chunk(kind, tuple(part.tolist())) for part in np.array_split(places, count)]
    return sorted(chunks, key=lambda chunk: -len(chunk.places) * chunk.kind.seconds)


def training_seconds(config: PPOConfig) -> float:
    """What a run is expected to take on one core, s."""
    return kind_of(config).seconds


def default_gib(workers: Workers) -> float:
    """Budget of memory of all workers together, GiB."""
    gib = GIB_PER_WORKER[workers.device] * workers.count
    if workers.device == "gpu" or not hasattr(os, "sysconf"):
        return gib
    machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30
    return min(gib, SHARE_OF_MEMORY * machine)


def _policies_that_fit(kind: Kind, gib: float, workers: int) -> int:
    """Policies that fit a worker's memory."""
    most = int((gib * 2**30 / workers - PROGRAM_BYTES) // kind.bytes)
    if most < 1:
        needed = workers * (PROGRAM_BYTES + kind.bytes) / 2**30
        raise InputError(
            f"`memory_gib`={gib:g} does not hold one policy in each of {workers} processes, which "
            f"takes {math.ceil(10.0 * needed) / 10.0:g} GiB; give more memory or fewer workers"
        )
    return most


def kind_of(config: PPOConfig) -> Kind:
    """What a run shares with those that it can be trained with.

    Raises:
        TypeError, ValueError: for a run that the fleet cannot train.
    """
    _check_engine(config)
    from integ_gym.envs import functional

    env = functional.make(config.env_id, **config.env_arguments)
    env.check_lanes(config.n_envs)
    alike: dict[str, Any] = {f.name: getattr(config, f.name, None) for f in fields(Algorithm)}
    algorithm = Algorithm(**alike | {"stops_early": config.target_kl is not None})
    return Kind(
        structure=env.structure,
        sizes=(len(env.setup.task.observation_names), *config.net_arch),
        algorithm=algorithm,
        substeps=tuple(setup.timing.substeps for setup in env.setups),
        rollouts=config.rounded_steps // config.rollout,
        entries=len(Layout(env.setup.plant, env.setup.task)),
        trace_every=config.trace_every,
    )


def _check_engine(config: PPOConfig) -> None:
    if config.env_arguments.get("contact") == "engine":
        raise InputError(f"the fleet cannot train with `contact`='engine'; {REMEDY}")
    members = [config.env_arguments, *config.env_arguments.get("mixture", ())]
    for engine in (str(member["engine"]) for member in members if "engine" in member):
        if not ENGINES.load(engine).batched:
            raise InputError(
                f"the fleet cannot train on engine {engine!r}, which is not made of JAX's "
                f"operations; {REMEDY}"
            )


_traceable: set[Hashable] = set()
"""Structures that this process has found traceable."""


def _check_traceable(kind: Kind, config: PPOConfig) -> None:
    """Go through one step of the environment as the compiler would."""
    if kind.structure in _traceable:
        return
    from integ_gym.envs import functional

    env = functional.make(config.env_id, **config.env_arguments)
    shape: Any = env.action_space.shape
    action = np.zeros((config.n_envs, *shape), env.action_space.dtype)

    def step(key: Any) -> Any:
        state = env.initial(key, lanes=(config.n_envs,))
        return env.step(state, action, key, env.default_params)

    try:
        with jax.enable_x64(False):
            jax.eval_shape(step, jax.random.key(0))
    except Exception as error:
        names = ", ".join(sorted({setup.settings.integrator for setup in env.setups}))
        reason = str(error).split("\n", 1)[0].rstrip(".")
        raise InputError(
            f"the fleet cannot compile {config.env_id} with {names} ({reason}); {REMEDY}"
        ) from error
    _traceable.add(kind.structure)
