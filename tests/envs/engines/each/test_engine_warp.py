"""MuJoCo Warp and Newton: recorded steps, worlds side by side, and what would falsify them."""

from __future__ import annotations

import ctypes
from functools import partial

import numpy as np
import pytest
from engine_cases import needs, setup_of
from engine_checks import new_setup

from integ_gym.envs.engines import warp as mujoco_warp
from integ_gym.envs.engines.newton import FEATHERSTONE
from integ_gym.envs.ops.ops import ARRAY, SCALAR

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
def test_a_solver_that_is_stopped_at_its_cap_has_not_converged(
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
