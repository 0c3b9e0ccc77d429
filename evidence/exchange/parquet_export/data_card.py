"""The data card of records in Parquet: what they are, for people, and for hubs of data sets."""

from __future__ import annotations

from collections import Counter
from typing import Any

from ...schema.arrow import described
from ...schema.fields import SCHEMA_VERSION
from ...store.parquet_file import check_schema
from ...store.store import EvidenceStore
from ..selection import Selection
from .croissant import CROISSANT_FILE

CARD_FILE = "README.md"


def data_card(chosen: Selection, store: EvidenceStore) -> str:
    """The card, in Markdown with a head that hubs read.

    Args:
        chosen: the records that are in the data set.
        store: in the folder ``evidence`` of it.
    """
    runs = ", ".join(f"`{run}`" for run in chosen.distinct("run_id"))
    traced = sum(chosen.values("reward IS NOT NULL AS traced"))
    parts = [
        _head(store),
        f"# Evidence of {runs}",
        f"{len(chosen.ids)} of {chosen.store.count()} records of integ-gym, those that are "
        f"`{chosen.where}`, schema version {SCHEMA_VERSION}: one episode in "
        f"a row, {traced} of them with a trace of every control step. "
        "`integ-gym evidence verify` recomputes outcomes and plays episodes again, and "
        f"`{CROISSANT_FILE}` describes the columns for machines.",
        "## What is in it",
        _table(("environment", "phase", "records"), _counted(chosen, "env_id", "phase")),
        "## Discretizations",
        _table(
            ("engine", "integrator", "dt, s", "control period, s", "records"),
            [tuple(one.values()) for one in chosen.discretizations()],
        ),
        "## Outcomes",
        _table(("phase", "failure label", "records"), _counted(chosen, "phase", "failure_label")),
        "## Columns",
        "Units are SI; columns of group `trace` are lists with one value for each control instant "
        "(`instant`) or step (`step`), whose last is null.",
        _table(("column", "type", "unit", "frame", "meaning"), _columns(store)),
        "## Limits",
        "Episodes are simulated: what they tell of hardware is for others to show. Of training "
        "only every n-th episode may be there, see `trace_every`. Null means not known or not "
        "applicable, never zero. No person is in the data. Licence and creator are to be stated "
        "by who publishes it.",
    ]
    return "\n\n".join(parts) + "\n"


def _head(store: EvidenceStore) -> str:
    configs = [
        line
        for file in store.files()
        for line in (f"- config_name: {file.stem}", f"  data_files: evidence/{file.name}")
    ]
    tags = ("reinforcement-learning", "numerical-integration", "gymnasium")
    listed = [f"- {tag}" for tag in tags]
    return "\n".join(("---", "tags:", *listed, "configs:", *configs, "---"))


def _counted(chosen: Selection, *columns: str) -> list[tuple[Any, ...]]:
    counts = Counter(chosen.values(*columns))
    return [(*key, count) for key, count in sorted(counts.items())]


def _columns(store: EvidenceStore) -> list[tuple[Any, ...]]:
    told: dict[str, tuple[Any, ...]] = {}
    for file in store.files():
        for column in check_schema(file):
            about = described(column)
            kind = str(column.type).replace("element: ", "").replace("item: ", "")
            row = (f"`{column.name}`", kind, about["unit"], about["frame"], about["meaning"])
            told.setdefault(column.name, row)
    return list(told.values())


def _table(names: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    lines = [names, ("---",) * len(names), *rows]
    return "\n".join("| " + " | ".join(map(_cell, line)) + " |" for line in lines)


def _cell(value: Any) -> str:
    if value is None:
        return "not known"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return text.replace("|", "\\|").replace("\n", " ")
