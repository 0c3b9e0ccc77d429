"""Drake: exact steps, no memory between them, and what its integrators report and refuse."""

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import DAMPING, mapped, needs, one_step, setup_of, states
from pairing import pairs

import integ_gym  # noqa: F401
from integ_gym.envs.engines.drake import DISCRETE, EXPLICIT, IMPLICIT, DrakeEngine
from integ_gym.envs.engines.maps import one_step_map
from integ_gym.envs.ops.ops import SCALAR

ALL = tuple(DrakeEngine.maps)
CONTINUOUS = (*EXPLICIT, *IMPLICIT)


def _setup(integrator: str, env_id: str = "IntegCartPole-v0", **arguments):
    return setup_of("drake", integrator, env_id, **arguments)


@pytest.mark.parametrize("integrator", ALL)
def test_a_step_depends_on_nothing_that_went_before(integrator):
    """To the last bit, in any order, and after a state in which Drake gives up or struggles."""
    setup = _setup(integrator)
    cases, n = states(setup, 6), len(setup.plant.coordinates)
    alone = [one_step(setup, *case) for case in cases]
    run = setup.engine.run(1)
    for astray in ([np.nan] * 6, (np.nan, 0.0, 0.0, np.nan, 0.0, 0.0)):
        assert not np.isfinite(run(*astray[: 3 * n])[: 2 * n]).all()
    for case, expected in reversed(list(zip(cases, alone, strict=True))):
        assert (one_step(setup, *case) == expected).all()
        q, v, control = case
        run(*q, *(90.0 * x for x in v), control, *[0.0] * (n - 1))
        for _ in range(2):
            assert run(*q, *v, control, *[0.0] * (n - 1))[: 2 * n] == tuple(expected)


@pytest.mark.parametrize("integrator", ALL)
def test_what_is_solved_is_reported_where_drake_tells(integrator):
    needs("drake")
    env = gym.make("IntegCartPole-v0", engine="drake", integrator=integrator, dt=0.02)
    env.reset(seed=0)
    *_, info = env.step(1)
    solver = env.unwrapped.setup.engine.solver()
    if integrator in DISCRETE:
        assert info["solver_status"] == "not_reported"
    else:
        assert info["solver_status"] == "ok"
    assert (info["solver_iterations"] > 0) is (integrator in IMPLICIT)
    assert solver["solver_tolerance"] == (1e-12 if integrator in IMPLICIT else None)


@pytest.mark.parametrize(("integrator", "dt"), pairs(IMPLICIT, (0.02, 0.1), strength=1))
def test_no_step_leaves_a_trace(integrator, dt):
    """To the last bit: not whole ones, nor those that Drake divides, nor those that it gives up."""
    engine, rng = _setup(integrator, dt=dt).engine, np.random.default_rng(11)
    cases = [
        (*rng.uniform(-3.0, 3.0, 2), *rng.uniform(-speed, speed, 2), rng.choice([-2.0, 0.0]), 0.0)
        for speed in np.repeat([1.0, 25.0, 150.0, 3e3, 3e5], 12)
    ]
    alone = [engine.run(1)(*case) for case in cases]
    lost = [not np.isfinite(end[0]) for end in alone]
    divided = [np.isfinite(end[0]) and not end[-1] for end in alone]
    assert min(sum(lost), sum(divided), len(cases) - sum(lost) - sum(divided)) >= 5
    run = engine.run(1)
    for place in rng.permutation(3 * len(cases)) % len(cases):
        np.testing.assert_array_equal(run(*cases[place]), alone[place])


@pytest.mark.parametrize("integrator", CONTINUOUS)
def test_damping_takes_what_it_takes_in_the_map(integrator):
    """Of every step that Drake does not divide; what a divided one loses is not known."""
    setup = _setup(integrator, **DAMPING["IntegCartPole-v0"])
    known, fast = one_step_map(setup.engine.map), ((0.1, 1.0), (150.0, 300.0), 2.0)
    kinds = set()
    for q, v, control in (*states(setup), fast):
        step = setup.engine.move(SCALAR, q, v, (0.3,), (control,))
        expected = known.step(SCALAR, setup.system, q, v, (0.3,), (control,), setup.engine.dt)
        kinds.add(step.converged)
        if step.converged:
            np.testing.assert_allclose(step.losses, expected.losses, rtol=1e-9, atol=0.0)
        else:
            assert np.isnan(step.losses[0])
    assert kinds == ({True, False} if integrator in IMPLICIT else {True})


@pytest.mark.parametrize("integrator", IMPLICIT)
def test_a_step_that_drake_divides_is_told_as_not_converged(integrator):
    """At a fixed step too, Drake goes on in parts where Newton's method fails."""
    setup = _setup(integrator)
    known, rng = one_step_map(setup.engine.map), np.random.default_rng(4)
    errors: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(60):
        q, v = tuple(rng.uniform(-3.0, 3.0, 2)), tuple(rng.uniform(-200.0, 200.0, 2))
        motion = setup.engine.advance(SCALAR, q, v, (((1.0,), 1),), None)
        expected = mapped(known, setup, q, v, 1.0)
        gaps = np.abs((*motion.q, *motion.v) - expected) / (1.0 + np.abs(expected))
        errors[motion.converged].append(gaps.max())
    assert max(errors[True]) < 1e-9
    assert min(errors[False]) > 1e-6


@pytest.mark.parametrize("integrator", IMPLICIT)
def test_a_step_that_drake_gives_up_is_a_divergence(integrator):
    needs("drake")
    env = gym.make("IntegCartPole-v0", engine="drake", integrator=integrator, dt=0.5)
    env.reset(seed=0, options={"state": (0.0, -600.0, 0.1, 900.0)})
    observation, _, terminated, _, info = env.step(1)
    assert terminated
    assert info["solver_status"] == "diverged"
    assert np.isfinite(observation).all()
