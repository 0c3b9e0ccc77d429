"""Summaries of many episodes at once agree with those worked out step by step."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from integ_gym.envs.registries import PLANTS, TASKS
from integ_gym.evidence.episodes import Layout, summarise

TASK = TASKS.load("pendulum_swing_up")
LAYOUT = Layout(PLANTS.load(TASK.plant), TASK, {"penetration": 0.0})

whole = st.integers(0, 3).map(float)
flags = st.booleans().map(float)
steps = st.lists(
    st.fixed_dictionaries(
        {
            "reward": whole,
            "energy_residual": st.integers(-3, 3).map(float),
            "fallback_used": flags,
            "saturated": flags,
            "solver_iterations": whole,
            "solver_status": st.integers(0, 2).map(float),
            "penetration": whole,
            "at_goal": st.booleans(),
        }
    ),
    min_size=1,
    max_size=6,
)
episodes = st.lists(st.tuples(st.booleans(), steps, st.booleans()), min_size=1, max_size=4)


def _rows(drawn):
    """The rows of the drawn episodes, shape (entries, rows), and how many each has."""
    rows = []
    for at_goal, each, success in drawn:
        since = 0.0 if at_goal else -1.0
        rows.append({"time": 0.0, "energy": 1.0, "goal_since": since})
        for k, step in enumerate(each, start=1):
            since = (since if since >= 0.0 else float(k)) if step["at_goal"] else -1.0
            row = {"time": float(k), "energy": 1.0 + k, "goal_since": since, "theta": 0.5}
            rows.append(row | {n: x for n, x in step.items() if n != "at_goal"})
        rows[-1]["success"] = float(success)
        rows[-1]["truncated"] = 1.0
    columns = np.array([[row.get(name, 0.0) for row in rows] for name in LAYOUT.names])
    return columns, np.array([len(each) + 1 for _, each, _ in drawn])


@given(episodes)
def test_summaries_agree_with_a_loop(drawn):
    rows, counts = _rows(drawn)
    found = summarise(LAYOUT, rows, counts)
    for i, (starts_at_goal, each, success) in enumerate(drawn):
        there = [starts_at_goal, *(step["at_goal"] for step in each)]
        fallback = [0.0, *(step["fallback_used"] for step in each)]
        reached = [k for k, x in enumerate(there) if x]
        left = [k for k in range(1, len(there)) if there[k - 1] and not there[k]]
        expected = {
            "length": len(each),
            "time": len(each),
            "return": sum(step["reward"] for step in each),
            "energy_start": 1.0,
            "energy_end": 1.0 + len(each),
            "energy_residual_total": sum(step["energy_residual"] for step in each),
            "energy_residual_abs_total": sum(abs(step["energy_residual"]) for step in each),
            "saturated_share": sum(step["saturated"] for step in each) / len(each),
            "fallback_count": sum(fallback),
            "recovery_count": sum(a > b for a, b in pairwise(fallback)),
            "solver_iterations_max": max(step["solver_iterations"] for step in each),
            "solver_iterations_mean": sum(s["solver_iterations"] for s in each) / len(each),
            "solver_status": max(step["solver_status"] for step in each),
            "penetration_max": max(step["penetration"] for step in each),
            "success": success,
            "truncated": True,
            "terminated": False,
            "goal_reached": min(reached, default=np.nan),
            "arrival_time": min(reached, default=np.nan),
            "arrival_energy": float(min(reached, default=np.nan)),
            "arrival_residual": sum(step["energy_residual"] for step in each[: reached[0]])
            if reached
            else np.nan,
            "goal_left": max(left, default=np.nan),
        }
        for name, value in expected.items():
            np.testing.assert_equal(float(found[name][i]), float(value), err_msg=name)
        assert np.isnan(found["constraint_violation_max"][i])
        if not success:
            assert np.isnan(found["time_to_success"][i])
        elif there[-1]:
            stay = len(there) - 1
            while stay > 0 and there[stay - 1]:
                stay -= 1
            assert found["time_to_success"][i] == stay
