"""The typed model of ``panel.json``: written, read and published as JSON Schema from here alone."""

from integ_gym.eval.panel_model.conclusions import (
    CellFinding,
    EngineAgreement,
    Failure,
    Median,
    PolicyComparison,
    Remedy,
    RemedyCell,
    RemedyLoss,
    TrainingCost,
    Verdict,
)
from integ_gym.eval.panel_model.files import FILE_NAME, read_panel, write_panel
from integ_gym.eval.panel_model.json_schema import json_schema
from integ_gym.eval.panel_model.matrix import Cell, Entry, Policy, Row, RowKind
from integ_gym.eval.panel_model.panel import SCHEMA_VERSION, Cost, Group, Panel
from integ_gym.eval.panel_model.part import Estimate, build

__all__ = [
    "FILE_NAME",
    "SCHEMA_VERSION",
    "Cell",
    "CellFinding",
    "Cost",
    "EngineAgreement",
    "Entry",
    "Estimate",
    "Failure",
    "Group",
    "Median",
    "Panel",
    "Policy",
    "PolicyComparison",
    "Remedy",
    "RemedyCell",
    "RemedyLoss",
    "Row",
    "RowKind",
    "TrainingCost",
    "Verdict",
    "build",
    "json_schema",
    "read_panel",
    "write_panel",
]
