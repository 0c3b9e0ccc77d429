"""The typed model of ``panel.json``: written, read and published as JSON Schema from here alone."""

from .conclusions import (
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
from .files import FILE_NAME, read_panel, write_panel
from .published import json_schema
from .matrix import Cell, Entry, Policy, Row, RowKind
from .panel import SCHEMA_VERSION, Cost, Group, Panel
from .part import Estimate, build

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
