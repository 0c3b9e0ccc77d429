"""What environments applied, from the records to the panel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pyarrow as pa
import pytest

from integ_gym.eval.panel.matrix import applied_in
from integ_gym.eval.panel.result import FILE_NAME, read_panel

ROUNDED = {
    "cell": "a", "engine": "playground", "engine_version": None, "integrator": "Euler",
    "dt": 0.007, "substeps": 3, "control_period": 0.021,
}  # fmt: skip


@dataclass
class Store:
    """Records of which a query finds what is given."""

    rows: list[dict[str, Any]]

    def query(self, sql: str) -> pa.Table:
        assert "DISTINCT" in sql
        return pa.Table.from_pylist(self.rows)


def test_every_cell_of_a_panel_says_what_its_environments_did(panel_directory):
    for cell in read_panel(panel_directory / FILE_NAME).cells:
        applied = cell.applied
        assert applied is not None
        assert (applied.engine, applied.integrator) == (cell.engine, cell.integrator)
        assert applied.dt * applied.substeps == pytest.approx(cell.control_period, rel=1e-12)
        assert cell.integrator == "reference" or applied.dt == cell.dt
        assert applied.engine_version


def test_records_of_a_cell_that_disagree_are_refused():
    with pytest.raises(ValueError, match="records of cell 'a' do not agree on engine, "):
        applied_in(Store([ROUNDED, {**ROUNDED, "substeps": 2}]))
