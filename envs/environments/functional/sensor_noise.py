"""Noise of the sensor of a functional environment: drawn once per sample, held in between."""

from __future__ import annotations

from typing import Any

from ...arithmetic import Component, Components, jax, jnp
from ...episode import EnvState, Setup
from ...plants import split_state


def standard_noise(setup: Setup, rng: Any, shape: tuple[int, ...], dtype: str) -> Components:
    """Standard normal noise, one component per state component; none without sensor noise."""
    if not setup.settings.observation_noise:
        return ()
    size = 2 * len(setup.plant.coordinates)
    return tuple(jax.random.normal(rng, (size, *shape), dtype))


def renewed(noise: Components, fresh: Components, sampled: Component) -> Components:
    """``fresh`` noise in the lanes that have taken a sample, else the last sample's."""
    return tuple(jnp.where(sampled, a, b) for a, b in zip(fresh, noise, strict=True))


def with_noise(
    env: EnvState, noise: Components, deviation: Component
) -> tuple[Components, Components]:
    """The last sample's coordinates and velocities, SI units.

    Args:
        env: episode state.
        noise: standard noise of the sample, one component per state component, or empty.
        deviation: standard deviation of each state component, SI.
    """
    q, v = env.sensed_q, env.sensed_v
    if noise:
        by_q, by_v = split_state(noise)
        q = tuple(a + deviation * b for a, b in zip(q, by_q, strict=True))
        v = tuple(a + deviation * b for a, b in zip(v, by_v, strict=True))
    return q, v
