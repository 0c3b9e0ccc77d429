"""`benchmarks/closed_loops.py`: fixed points, areas and arrivals against what is known."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from integ_gym.eval.panel.result import FILE_NAME, read_panel

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))
import closed_loops

sys.path.pop(0)


def test_the_fixed_point_of_a_map_that_is_known():
    rng = np.random.default_rng(0)
    matrices = 0.5 * rng.standard_normal((6, 2, 2))
    offsets = 0.01 * rng.standard_normal((6, 2))

    def advanced(states):
        return np.einsum("nij,nkj->nki", matrices, states) + offsets[:, None]

    fixed, jacobian, missed = closed_loops._fixed_points(advanced, 6)
    expected = [np.linalg.solve(np.eye(2) - a, b) for a, b in zip(matrices, offsets, strict=True)]
    np.testing.assert_allclose(fixed, expected, atol=1e-9)
    np.testing.assert_allclose(jacobian, matrices, atol=1e-9)
    assert missed.max() < 1e-9


@given(st.lists(st.tuples(st.integers(0, 5), st.booleans()), min_size=2, max_size=20))
def test_the_area_is_the_chance_that_a_failure_has_the_larger_value(pairs):
    values = np.array([value for value, _ in pairs], dtype=float)
    failed = np.array([lost for _, lost in pairs])
    chances = [(a > b) + 0.5 * (a == b) for a in values[failed] for b in values[~failed]]
    expected = np.mean(chances) if chances else np.nan
    assert closed_loops.roc_area(values, failed) == pytest.approx(expected, nan_ok=True)


def test_radii_of_a_real_panels_policies(panel_directory):
    """Of the map of one control period: the truth's is that of a fine integrator, not of 0.05 s."""
    panel = read_panel(panel_directory / FILE_NAME)
    row = panel.row("rk4 dt=0.05")
    radii = {
        name: closed_loops.spectral_radii(panel, panel_directory, row, panel.cell(name))
        for name in ("reference dt=0.05", "rk4 dt=0.0125", "explicit_euler dt=0.05")
    }
    assert all(own.shape == (row.seeds,) for own in radii.values())
    known = np.isfinite(radii["reference dt=0.05"])
    close = np.abs(radii["rk4 dt=0.0125"] - radii["reference dt=0.05"])[known]
    assert (close < 1e-6).all()


def test_arrivals_are_those_of_the_records(panel_directory):
    """Energy, speed and share come from the trace's first instant at the goal."""
    record = {
        "policy_id": "p", "success": True, "theta": [3.0, 1.0, 0.15, 0.0],
        "theta_dot": [0.0, 2.0, -1.5, 0.1], "energy": [0.0, 4.0, 9.0, 10.0],
        "energy_residual": [1.0, 2.0, 5.0],
    }  # fmt: skip
    found = closed_loops._arrival(record)
    assert found == {"policy": "p", "failed": False, "speed": 1.5, "share": pytest.approx(3 / 9)}
    assert closed_loops._arrival(record | {"theta": [3.0] * 4}) is None
