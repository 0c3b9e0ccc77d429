"""Every engine that can be installed here, with its integrators and the plants that it moves.

Those with an environment of their own are tested against a recorded exchange.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from pairing import pairs

from integ_gym.envs.engines.stepping import missing_modules
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import ENGINES, INTEGRATORS, MAPS
from integ_gym.envs.settings import Setup
from integ_gym.support.isolated import ISOLATED

ELSEWHERE = tuple(name for name in ENGINES.names() if name in ISOLATED)
"""Engines that run in an environment of their own, and so not here."""
FOREIGN = tuple(name for name in ENGINES.names() if name not in ("native", *ELSEWHERE))
RECORDED_IDS = ("IntegPendulum-v0", "IntegCartPole-v0")
"""Environments of the recorded exchanges with engines that run elsewhere."""
IDS = (*RECORDED_IDS, "IntegAcrobot-v0")
DAMPING = {
    "IntegPendulum-v0": {"damping": 0.3},
    "IntegCartPole-v0": {"damping": 0.02, "cart_damping": 0.4},
    "IntegAcrobot-v0": {"damping": 0.3},
}
TOLERANCE = {64: 1e-9, 32: 2e-6}
"""Of the one-step identity, by the width of the engine's floats."""

EVERY = [(engine, integrator) for engine in FOREIGN for integrator in ENGINES.load(engine).maps]
"""Every integrator of every engine."""

FIRST = [(engine, next(iter(ENGINES.load(engine).maps))) for engine in FOREIGN]
"""Each engine with one of its integrators."""

COMPILING = ("mjx", "mujoco_warp", "newton")
"""Engines that take seconds to compile what moves a plant with an integrator."""

STOPPED = [
    (engine, integrator)
    for engine in FOREIGN
    if (owner := ENGINES.load(engine)).own_stops
    for integrator in owner.maps
    if integrator not in owner.stopless
]
"""Every integrator that heeds its engine's own stops."""


def lighter(cases: Sequence[tuple[str, ...]]) -> list[Any]:
    """Engines, integrators and what follows; engines that compile are marked slow."""
    return [
        pytest.param(*case, marks=pytest.mark.slow) if case[0] in COMPILING else case
        for case in cases
    ]


def sparing(*axes: Iterable[Any], strength: int = 2) -> list[Any]:
    """Every integrator of every engine with values of axes; once, of engines that compile."""
    light = [case for case in EVERY if case[0] not in COMPILING]
    heavy = [case for case in EVERY if case[0] in COMPILING]
    chosen = *pairs(light, *axes, strength=strength), *pairs(heavy, *axes, strength=1)
    return [(*case, *values) for case, *values in chosen]


def native_name(name: str) -> str:
    """The map as an integrator of the native engine."""
    if name in INTEGRATORS.names():
        return name
    owner = MAPS.load(name)
    return f"{owner.__module__}:{owner.__name__}"


def needs(engine: str) -> None:
    """Skip where the engine is not installed, visibly."""
    missing = missing_modules(engine)
    if missing:
        pytest.skip(f'{", ".join(missing)} not installed: pip install -e ".[{engine}]"')


def setup_of(engine: str, integrator: str, env_id: str, **arguments: Any) -> Setup:
    """The setup of an environment on an engine; made once for equal arguments."""
    needs(engine)
    return _setup(engine, integrator, env_id, tuple(sorted(arguments.items())))


@cache
def _setup(engine: str, integrator: str, env_id: str, arguments: Any) -> Setup:
    chosen = {"dt": 0.02, **dict(arguments)}
    return environment_setup(env_id, {"engine": engine, "integrator": integrator, **chosen})


def states(setup: Setup, count: int = 20, strongest: float = 3.0) -> list[tuple[Any, Any, float]]:
    """(q, v, control) at random: fast spins and both signs included; controls to ±strongest."""
    rng, n = np.random.default_rng(7), len(setup.plant.coordinates)
    return [
        (
            tuple(rng.uniform(-3.0, 3.0, n).tolist()),
            tuple(rng.uniform(-6.0, 6.0, n).tolist()),
            float(rng.uniform(-strongest, strongest)),
        )
        for _ in range(count)
    ]


def one_step(setup: Setup, q: Any, v: Any, control: float) -> np.ndarray:
    """(q, v) after one of the engine's steps."""
    motion = setup.engine.advance(SCALAR, q, v, (((control,), 1),), None)
    return np.array((*motion.q, *motion.v))


def solved(setup: Setup, cases: list[tuple[Any, Any, float]]) -> list[tuple[Any, Any, float]]:
    """Those from which the engine's solver converges; of others it goes on in ways of its own."""
    return [
        (q, v, control)
        for q, v, control in cases
        if setup.engine.advance(SCALAR, q, v, (((control,), 1),), None).converged
    ]


def mapped(one_step_map: Any, setup: Setup, q: Any, v: Any, control: float) -> np.ndarray:
    """(q, v) after one step of a map."""
    system = setup.system
    end = one_step_map.step(SCALAR, system, q, v, system.no_losses, (control,), setup.timing.dt)
    return np.array((*end.q, *end.v))


def assert_accelerations(setup: Setup, states: Sequence[tuple[Any, Any]], controls: Any) -> None:
    """Those that an engine reports before a step, at every state or at none, are the plant's."""
    reported = 0
    for q, v in states:
        found = setup.engine.acceleration(q, v, setup.system.forces(SCALAR, q, v, controls))
        if found is not None:
            expected, _ = setup.system.rates(SCALAR, q, v, controls)
            np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)
            reported += 1
    assert reported in (0, len(states))
