"""Synthetic panels for tests of the report."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from report_judged import compared, failures, judge, remedy, training_cost
from report_rows import (
    EPISODES,
    IMPOSSIBLE,
    PERIOD,
    SCHEMES,
    SLOW,
    STEPS,
    TRUTH,
    UNKNOWN,
    baselines,
    complete,
    extra_cells,
    grid_cells,
    matrix_entry,
    mixture,
    row,
    trained,
)

HOSTILE = "<script>alert('x')</script>&\"'`{{ 7*7 }}$\\frac{"


def base_panel(
    rows: list[dict[str, Any]], cells: list[dict[str, Any]], seed: int
) -> dict[str, Any]:
    """A panel of rows and cells with its matrix filled."""
    rng = np.random.default_rng(seed)
    skipped = {"perturbation", "ladder"}
    panel: dict[str, Any] = {
        "schema_version": 6,
        "name": "quick",
        "question": "Does a policy trained on one integrator survive another?",
        "spec": {
            "env_id": "IntegPendulum-v0",
            "environment": {"max_torque": 0.8, "start": "hanging", "duration": 10.0},
            "control_period": PERIOD,
            "training": {
                "algorithm": "ppo",
                "total_steps": 300_000,
                "learning_rate": 1e-3,
                "discount_time": 1.0,
            },
            "episodes": EPISODES,
            "seeds": [0, 1, 2, 3, 4],
            "family": [["explicit_euler dt=0.05", TRUTH]],
        },
        "versions": {"integ-gym": "0.1.0", "gymnasium": "1.2.0", "numpy": "2.4.6"},
        "created": "2026-11-21T12:00:00Z",
        "platform": "Linux-6.1-x86_64",
        "cost": {
            "wall_seconds": 611.0,
            "train_seconds": 900.0,
            "evaluate_seconds": 80.0,
            "workers": 2,
        },
        "command": "integ-gym panel specs/quick.toml --out runs/panel",
        "directory": "runs/panel",
        "rows": rows,
        "cells": cells,
        "matrix": [
            matrix_entry(line, place, rng)
            for line in rows
            for place in cells
            if place["kind"] not in skipped or line["kind"] == "trained"
        ],
        "verdicts": [],
        "policy_comparisons": [],
        "failures": [],
        "failures_total": 0,
    }
    complete(panel)
    panel["failures_total"] = sum(
        count for e in panel["matrix"] for name, count in e["labels"].items() if name != "none"
    )
    return panel


def full_panel(seeds: int = 5, seed: int = 0) -> dict[str, Any]:
    """Everything a panel can hold."""
    schemes = ("explicit_euler", "symplectic_euler", "rk4", "implicit_euler", "reference")
    rows = [*trained(schemes, seeds), mixture(seeds), *baselines(seeds)]
    panel = base_panel(rows, [*grid_cells(SCHEMES, STEPS), *extra_cells()], seed)
    panel["remedies"] = [remedy(panel)]
    panel["training_costs"] = {
        line["name"]: training_cost(None if "implicit" in line["name"] else 161_400.0, seeds)
        for line in rows
        if line["kind"] == "trained"
    }
    panel["verdicts"] = judge(
        panel,
        [
            ("explicit_euler dt=0.05", TRUTH),
            ("symplectic_euler dt=0.05", TRUTH),
            ("rk4 dt=0.05", TRUTH),
            (TRUTH, "explicit_euler dt=0.05"),
            ("implicit_euler dt=0.05", TRUTH),
            ("rk4 dt=0.05", IMPOSSIBLE),
            ("rk4 dt=0.05", SLOW),
            ("rk4 dt=0.05", UNKNOWN),
        ],
    )
    panel["policy_comparisons"] = compared()
    panel["failures"] = failures(panel, 24)
    return panel


def every_verdict_panel() -> dict[str, Any]:
    """Seeds enough for every verdict, and cells of every kind."""
    rows = [*trained(("explicit_euler", "rk4", "implicit_euler", "reference"), 48), *baselines(48)]
    panel = base_panel(rows, grid_cells(("explicit_euler", "rk4", "implicit_euler"), STEPS), 4)
    panel["verdicts"] = judge(
        panel,
        [
            ("explicit_euler dt=0.05", TRUTH),
            ("rk4 dt=0.05", TRUTH),
            ("explicit_euler dt=0.05", "explicit_euler dt=0.0125"),
            ("implicit_euler dt=0.05", TRUTH),
            ("rk4 dt=0.05", IMPOSSIBLE),
            ("rk4 dt=0.05", SLOW),
            ("rk4 dt=0.05", UNKNOWN),
        ],
    )
    return panel


def paired(cell: str, place: int) -> dict[str, Any]:
    """What a given policy loses on the place-th cell; on every fifth no return is finite."""
    share, finite = (place % 7 - 2) / 5.0, place % 5 > 0
    ends = {"low": max(share - 0.15, -1.0), "high": min(share + 0.1, 1.0), "level": 0.95}
    earned = {"estimate": 900.0 * share, "low": 900.0 * share - 50.0, "high": 900.0 * share + 60.0}
    return {
        "row": "my_policy.zip",
        "cell": cell,
        "against": "truth",
        "scope": "this policy, these starts",
        "episodes": 40,
        "success": {"estimate": share, **ends},
        "p_success": 0.0004 if share else 1.0,
        "p_success_adjusted": 0.012 if share else 1.0,
        "returns": {**earned, "level": 0.95} if finite else None,
        "p_return": 0.002 if finite else None,
        "p_return_adjusted": 0.06 if finite else None,
    }


def given_panel() -> dict[str, Any]:
    """One given policy of one seed: no verdicts, no gaps."""
    rows = [row("my_policy.zip", "given", None, 1)]
    rows[0]["integrator"], rows[0]["dt"] = "explicit_euler", STEPS[0]
    panel = base_panel(rows, grid_cells(SCHEMES[:3], STEPS), 1)
    rows[0]["learned"] = None
    for entry in panel["matrix"]:
        entry["success"] = {**entry["success"], "low": None, "high": None}
    panel["paired"] = [paired(entry["cell"], k) for k, entry in enumerate(panel["matrix"])]
    panel["doubts"] = ["The policy file names no training discretization."]
    return panel


def nothing_learned_panel() -> dict[str, Any]:
    """Trained rows of which none reached a home success of one half."""
    rows = [*trained(("implicit_euler",), 5), *baselines(5)]
    panel = base_panel(rows, grid_cells(SCHEMES[:2] + SCHEMES[3:4], STEPS), 2)
    panel["verdicts"] = judge(panel, [("implicit_euler dt=0.05", TRUTH)])
    return panel


def none_panel() -> dict[str, Any]:
    """The full panel with null wherever null is allowed, and what may be empty empty."""
    panel = full_panel(seeds=2)
    for entry in panel["matrix"]:
        entry.update(dict.fromkeys(("return", "time_to_success", "reference_class")))
        entry.update(energy_residual=None, energy_residual_abs=None, labels={}, file=[])
        entry.update(home_drop=None, transfer_gap=None, success_by_seed=[])
        entry.update(difficulty=None, deadline=None, overfitting=None)
        for rate in ("success", "recovered"):
            entry[rate].update(low=None, high=None, level=None)
    for line in panel["rows"]:
        line.update(home=None, integrator=None, dt=None, control_period=None)
        line.update(home_success=None, learned=None, training_steps=None, policies=[], shares={})
    for place in panel["cells"]:
        place.update(role=None, achievability=None, best=None, search=None)
    for judged in panel["verdicts"]:
        judged.update(p_exceeds=None, p_equivalent=None)
        judged.update(p_exceeds_adjusted=None, p_equivalent_adjusted=None)
        for part in ("total", "difficulty", "deadline", "overfitting"):
            judged[part].update(low=None, high=None, level=None)
    panel.update(remedies=[], training_costs={}, spec={}, versions={})
    panel.update(failures=[], failures_total=0, policy_comparisons=[])
    return panel


def hostile_panel() -> dict[str, Any]:
    """Names, texts and paths that try to break out of the page or out of mathtext."""
    panel = copy.deepcopy(full_panel())

    def poison(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {name: poison(entry, name) for name, entry in value.items()}
        if isinstance(value, list):
            return [poison(entry, key) for entry in value]
        words = {"name", "row", "cell", "home", "reason", "question", "command", "a", "b"}
        words |= {"integrator", "perturbation", "record_id", "query", "platform", "id", "singles"}
        return f"{value}{HOSTILE}" if isinstance(value, str) and key in words else value

    panel = {name: poison(value, name) for name, value in panel.items()}
    for entry in panel["matrix"]:
        entry["file"] = ["javascript:alert(1)", "//evil.example/x", 'a" onclick="alert(1)']
        entry["labels"] = {HOSTILE: 3, **entry["labels"]}
    panel["spec"][HOSTILE] = HOSTILE
    return panel


def large_panel() -> dict[str, Any]:
    """Twenty rows and thirty-one columns."""
    steps = (0.1, 0.05, 0.025, 0.0125, 0.00625, 0.003125)
    rows = [line for dt in steps[:3] for line in trained(SCHEMES, 5, dt)]
    rows += [row(f"given {number}", "given", "rk4", 1) for number in range(2)]
    return base_panel([*rows, *baselines(5)], grid_cells(SCHEMES, steps), 3)
