"""Whatever the parameters, states, actions and steps: no NaN leaves `step`, and ledgers close."""

from __future__ import annotations

from dataclasses import fields

import gymnasium as gym
import numpy as np
import pytest
from checks import ALL, APPROXIMATE
from hypothesis import given, settings
from hypothesis import strategies as st

import integ_gym
from integ_gym.envs.engines.stepping import DIVERGENCE_SPEED
from integ_gym.envs.numerics.energy import ledger
from integ_gym.envs.numerics.stepping import fastest_rate, probe_state
from integ_gym.envs.registries import ENVIRONMENTS, PLANTS
from integ_gym.envs.tasks.interface import to_public_order

FASTEST_START = 3.0
"""Speed that starts of any environment may have; a limit below it is refused."""

STEPS = 5


STIFF = ("friction", "stop")
"""Parts of the names of parameters that make forces change over a small fraction of a step."""


def _parameters(owner, span, smooth=False):
    """Physical parameters within a factor of `span` of their defaults, or from 0 up to `span`.

    A `smooth` motion has no friction and no stops.
    """
    return st.fixed_dictionaries(
        {
            f.name: st.floats(0.0, span)
            if f.default == 0.0
            else st.floats(f.default / span, f.default * span)
            for f in fields(owner)
            if isinstance(f.default, float) and not (smooth and any(p in f.name for p in STIFF))
        }
    )


def _actions(space):
    if isinstance(space, gym.spaces.Discrete):
        return st.one_of(st.integers(0, int(space.n) - 1), st.sampled_from([np.nan, np.inf]))
    entry, size = st.floats(allow_nan=True, allow_infinity=True), space.shape[0]
    return st.lists(entry, min_size=size, max_size=size).map(np.array)


def _finite(values):
    return all(np.isfinite(x) for x in values if not isinstance(x, str))


@pytest.mark.parametrize("integrator", ALL)
@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_no_nan_leaves_step_and_the_ledger_is_what_it_says(env_id, integrator):
    default = gym.make(env_id).unwrapped
    owner = type(default.setup.plant)
    size = 2 * len(owner.coordinates)
    adaptive = integrator == "reference"  # takes as many inner steps as the motion needs
    span, speed = (2.0, 20.0) if adaptive else (30.0, DIVERGENCE_SPEED)

    @given(
        parameters=_parameters(owner, span),
        state=st.lists(st.floats(-speed, speed), min_size=size, max_size=size),
        actions=st.lists(_actions(default.action_space), min_size=STEPS, max_size=STEPS),
        dt=st.floats(1e-4, 0.02 if adaptive else 1.0),
        max_speed=st.one_of(st.none(), st.floats(FASTEST_START, DIVERGENCE_SPEED)),
    )
    @settings(max_examples=3 if adaptive else 10, deadline=None)
    def check(parameters, state, actions, dt, max_speed):
        env = gym.make(
            env_id, integrator=integrator, dt=dt, max_speed=max_speed, duration=1e3,
            disable_env_checker=True, **parameters,
        )  # fmt: skip
        start = np.array(state)
        limits = env.unwrapped.setup.system.speed_limits
        if limits is not None:
            start[1::2] = np.clip(start[1::2], np.negative(limits), limits)
        start = to_public_order(env.unwrapped.setup.task, start)
        _, info = env.reset(options={"state": start})
        for action in actions:
            before = info["energy"]
            observation, reward, terminated, _, info = env.step(action)
            assert np.isfinite(observation).all()
            assert np.isfinite(env.unwrapped.state).all()
            assert _finite([reward, *info.values()])
            _assert_residual_is_defined(info, before)
            if info["solver_status"] == "diverged":
                assert terminated
            if terminated:
                break

    check()


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_no_nan_in_100_000_random_decisions(env_id):
    """Of 500 lanes at the environment's own discretization, through the ends of episodes."""
    envs = gym.make_vec(env_id, 500, vectorization_mode="vector_entry_point", duration=1.0)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    ended = 0
    for _ in range(200):
        observation, reward, terminated, truncated, info = envs.step(envs.action_space.sample())
        numbers = [x for x in info.values() if np.asarray(x).dtype.kind == "f"]
        assert np.isfinite(observation).all()
        assert np.isfinite(envs.unwrapped.state).all()
        assert all(np.isfinite(x).all() for x in (reward, *numbers))
        ended += np.count_nonzero(terminated | truncated)
    assert ended > 0


def _assert_residual_is_defined(info, before):
    terms = [
        info["energy"], -before, -info["actuator_work"], info["dissipated"], info["clip_loss"],
        info.get("contact_loss", 0.0),
    ]  # fmt: skip
    rounding = 1e-12 * sum(abs(x) for x in terms)
    assert abs(info["energy_residual"] - sum(terms)) <= rounding
    assert info["dissipated"] >= 0.0


@pytest.mark.parametrize("integrator", APPROXIMATE)
@pytest.mark.parametrize("name", PLANTS.names())
def test_residual_falls_with_dt(name, integrator):
    owner = PLANTS.load(name)

    @given(
        parameters=_parameters(owner, 2.0, smooth=True),
        controls=st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=8),
        shift=st.floats(-0.5, 0.5),
    )
    @settings(max_examples=5, deadline=None)
    def check(parameters, controls, shift):
        plant = owner(**parameters)
        state = probe_state(plant) + shift
        # Without gravity and springs the linear rate is near 0, and controls set the pace.
        period = 0.3 / max(fastest_rate(plant, state), 2.0)
        coarse = [ledger(integrator, plant, state, controls, period, n) for n in (3, 4, 5)]
        fine = ledger(integrator, plant, state, controls, period, 32)
        size = 1.0 + abs(fine.energy_change_j) + abs(fine.work_j) + fine.losses_j
        largest = max(run.total_residual_j for run in coarse)
        assert fine.total_residual_j <= 0.5 * largest + 1e-10 * size

    check()
