"""The model of ``panel.json``: written, read back, refused, and published as JSON Schema."""

from __future__ import annotations

import copy
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pyarrow as pa
import pytest
from report_pages import every_panel, panel_of, raw_of

from integ_gym.eval.panel.checking.page import check_finished
from integ_gym.eval.panel.matrix import read_applied
from integ_gym.eval.panel.result import (
    FILE_NAME,
    SCHEMA_PATH,
    json_schema,
    read_panel,
    schema_text,
    write_panel,
)
from integ_gym.eval.panel.run_directory import RunDirectoryError


def _read(raw: Any, directory: Path) -> Any:
    (directory / FILE_NAME).write_text(json.dumps(raw), encoding="utf-8")
    return read_panel(directory / FILE_NAME)


@every_panel
def test_what_is_written_is_read_back_and_fits_the_schema(name: str, tmp_path: Path) -> None:
    path = write_panel(panel_of(name), tmp_path)
    assert read_panel(path) == panel_of(name)
    jsonschema.validate(json.loads(path.read_text(encoding="utf-8")), json_schema())


@pytest.mark.slow
def test_a_finished_panel_fits_the_schema(panel_directory: Path) -> None:
    written = json.loads((panel_directory / FILE_NAME).read_text(encoding="utf-8"))
    jsonschema.validate(written, json_schema())
    del written["matrix"][0]["success"]["low"]
    with pytest.raises(jsonschema.ValidationError, match="'low' is a required property"):
        jsonschema.validate(written, json_schema())


def test_the_published_schema_is_what_the_model_gives() -> None:
    assert SCHEMA_PATH.read_text(encoding="utf-8") == schema_text()
    jsonschema.Draft202012Validator.check_schema(json_schema())
    for part in json_schema()["$defs"].values():
        for name, kind in part["properties"].items():
            assert kind["description"], (part["title"], name)


def test_numbers_that_are_not_finite_are_never_written(tmp_path: Path) -> None:
    panel = panel_of("full")
    cost = msgspec.structs.replace(panel.cost, wall_seconds=float("nan"))
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_panel(msgspec.structs.replace(panel, cost=cost), tmp_path)
    assert not (tmp_path / FILE_NAME).exists()


def _twice(raw: dict[str, Any]) -> None:
    raw["rows"][1]["name"] = raw["rows"][0]["name"]


def _undeclared(raw: dict[str, Any]) -> None:
    raw["matrix"][0]["row"] = "x"


def _repeated(raw: dict[str, Any]) -> None:
    raw["matrix"].append(raw["matrix"][0])


def _lacking(raw: dict[str, Any]) -> None:
    del raw["matrix"][3]["success"]


def _mistyped(raw: dict[str, Any]) -> None:
    raw["cells"][2]["dt"] = "0.05"


def _foreign(raw: dict[str, Any]) -> None:
    raw["opinion"] = "good"


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (_twice, "row names that differ, got 'explicit_euler dt=0.05' more than once"),
        (_undeclared, "the matrix has 'x' in 'explicit_euler dt=0.05', but rows and cells do not"),
        (_repeated, "entry names that differ"),
        (_lacking, "missing required field `success` - at `$.matrix[3]`"),
        (_mistyped, "Expected `float`, got `str` - at `$.cells[2].dt`"),
        (_foreign, "unknown field `opinion`"),
    ],
)
def test_damaged_files_are_refused_with_the_place_and_the_remedy(
    damage: Any, message: str, tmp_path: Path
) -> None:
    raw = copy.deepcopy(raw_of("full"))
    damage(raw)
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        _read(raw, tmp_path)
    assert "run the panel again to write it anew" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("version", [1, 2, 3, 4, 5, 6, 8, None, "7"])
def test_other_versions_are_refused_with_the_remedy(version: Any, tmp_path: Path) -> None:
    message = (
        f"has schema_version {version!r}, and this version of integ-gym reads 7; use the version"
    )
    with pytest.raises(ValueError, match=re.escape(message)):
        _read({**raw_of("full"), "schema_version": version}, tmp_path)
    with pytest.raises(RunDirectoryError, match=re.escape(message)):
        check_finished(tmp_path)


@pytest.mark.parametrize("content", ["", "{", "[]", "3", "\x00"])
def test_what_is_no_panel_is_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text(content, encoding="utf-8")
    with pytest.raises(ValueError, match="is damaged or holds no panel"):
        read_panel(tmp_path / FILE_NAME)


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
        assert (applied.engine, applied.integrator) == (cell.engine, cell.integrator)
        assert applied.dt * applied.substeps == pytest.approx(cell.control_period, rel=1e-12)
        assert cell.integrator == "reference" or applied.dt == cell.dt
        assert applied.engine_version


def test_records_of_a_cell_that_disagree_are_refused():
    with pytest.raises(ValueError, match="records of cell 'a' do not agree on engine, "):
        read_applied(Store([ROUNDED, {**ROUNDED, "substeps": 2}]))
