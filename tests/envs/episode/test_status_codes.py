"""The solver's status is kept as a code and told in words."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import integ_gym  # noqa: F401
from integ_gym.envs.transition import DIVERGED, STATUS_NAMES

DIVERGING = {"integrator": "explicit_euler", "dt": 0.5, "mass": 0.01, "damping": 5.0}
LANES = 4


def _words(codes):
    return [STATUS_NAMES[code] for code in codes]


@pytest.mark.parametrize("mode", AutoresetMode)
def test_vector_environment(mode):
    members = [DIVERGING, {**DIVERGING, "integrator": "rk4", "dt": 0.001}]
    mixture = [{name: member[name] for name in ("integrator", "dt")} for member in members]
    env = gym.make_vec(
        "IntegPendulum-v0", num_envs=LANES, autoreset_mode=mode, mixture=mixture, mass=0.01,
        damping=5.0, control_period=0.5,
    )  # fmt: skip
    env.reset(seed=0, options={"mixture_index": np.array([0, 1, 0, 1])})
    seen = set()
    for _ in range(12):
        _, _, terminated, truncated, info = env.step(np.zeros((LANES, 1), np.float32))
        done = terminated | truncated
        words = info["solver_status"].copy()
        if mode is AutoresetMode.SAME_STEP and done.any():
            assert set(words[done]) == {"ok"}
            final = info["final_info"]["solver_status"]
            assert [word is None for word in final] == (~done).tolist()
            words[done] = final[done]
        assert _words(env.status_codes) == words.tolist()
        assert (env.status_codes[terminated] == DIVERGED).all()
        seen |= set(words)
        if mode is AutoresetMode.DISABLED and done.any():
            _, info = env.reset(options={"reset_mask": done})
            told = info["solver_status"]
            assert [word is None for word in told] == (~done).tolist()
    assert seen == {"ok", "diverged"}
