"""Docstrings of the environments: their tables of arguments say what the definitions say."""

from __future__ import annotations

from dataclasses import Field, fields
from typing import Any

import pytest

import integ_gym
from integ_gym.envs.environment import environment_class, environment_setup

HEAD = "| Name | Default | Unit | Meaning |\n|---|---|---|---|\n"


def written(value: Any) -> str:
    """A default as the tables write it; numbers with at most four digits."""
    if isinstance(value, str):
        return f'`"{value}"`'
    if isinstance(value, float):
        return min(repr(value), f"{value:.4g}", key=len) if len(repr(value)) > 8 else repr(value)
    return f"`{value!r}`"


def row(name: str, default: str, unit: str, meaning: str) -> str:
    return f"| `{name}` | {default} | {unit} | {meaning} |".replace("|  |", "| |")


def rows_of(env_id: str) -> list[str]:
    """The table's rows as the definitions have them."""
    setup = environment_setup(env_id, {})
    common, *own = (
        {f.name: f for f in fields(part)}  # type: ignore[arg-type]
        for part in (setup.settings, setup.plant, setup.task)
    )
    values = setup.arguments()

    def rows(parts: dict[str, Field[Any]]) -> list[str]:
        return [
            row(name, written(values[name]), f.metadata["unit"], f.metadata["meaning"])
            for name, f in parts.items()
        ]

    starts = " or ".join(f"`{start}`" for start in setup.task.starts)
    shared = [
        line.replace("| start distribution |", f"| start distribution: {starts} |")
        for line in rows(common)
    ]
    modes = " or ".join(f'`"{mode}"`' for mode in ("rgb_array", "human"))
    return [*shared, row("render_mode", "`None`", "", modes), *rows({**own[0], **own[1]})]


@pytest.mark.parametrize("env_id", integ_gym.ENVIRONMENTS)
def test_tables_of_arguments(env_id):
    documentation = environment_class(env_id).__doc__ or ""
    (_, table) = documentation.split("## Arguments")[1].split(HEAD.replace("\n", "\n    "))
    lines = [line.strip() for line in table.split("\n\n")[0].splitlines()]
    expected = rows_of(env_id)
    assert len(expected) > 13
    assert lines == expected, "write the table as:\n" + "\n".join(expected)
