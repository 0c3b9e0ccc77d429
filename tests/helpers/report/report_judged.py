"""What a synthetic panel concludes from its matrix."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from report_rows import (
    EPISODES,
    TRUTH,
    difference,
    loss_rates,
    mixture,
    solvable,
)

from integ_gym.eval.power import Comparison, judge_family
from integ_gym.eval.verdict import PolicyCell, compare_policies

DRAWS = 20_000
"""Draws of a verdict: enough that none of these is close."""

REASONS = {
    "evaluation_error": "the simulation diverged at 6.85 s.",
    "unachievable": (
        "a search over controls misses the goal's energy here from most starts, in twice the time "
        "too; it never came within "
        "0.2 rad of upright."
    ),
    "not_learned": (
        "the policy succeeds from 0 % of its starts at home; it never came within "
        "0.2 rad of upright."
    ),
    "too_slow": (
        "the same policy succeeds from the same start in twice the time; it reached the goal at "
        "9.8 s"
    ),
    "discretization_error": (
        "the same policy succeeds from the same start on its training discretization, but it "
        "never came within 0.2 rad of upright and was saturated in 31 % of the steps"
    ),
    "planning_error": "it never came within 0.2 rad of upright and was saturated in 3 % of the "
    "steps",
    "control_error": "it reached the goal at 4.1 s and left it at 6.3 s",
}
"""What a record says, by label."""


def judge(panel: dict[str, Any], pairs: list[tuple[str, str]]) -> list[dict[str, Any]]:
    """Verdicts on a family of (row, cell)."""
    family = []
    for line, place in pairs:
        rates = loss_rates(panel, line, place)
        assert rates is not None
        family.append(Comparison(line, place, rates, solvable(panel, place)))
    return msgspec.to_builtins(list(judge_family(family, draws=DRAWS)))


def failures(panel: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """A sample of failing episodes."""
    sample = []
    trained = {line["name"] for line in panel["rows"] if line["kind"] != "baseline"}
    for number, entry in enumerate(panel["matrix"]):
        if entry["row"] not in trained:
            continue
        for label in [name for name in entry["labels"] if name != "none"][:1]:
            sample.append(
                {
                    "row": entry["row"],
                    "cell": entry["cell"],
                    "policy": f"{entry['row'].replace(' ', '-')}-seed{number % 5}",
                    "episode_index": number % EPISODES,
                    "record_id": f"{(number * 2654435761) % 16**16:016x}",
                    "label": label,
                    "reason": f"{REASONS[label]} on {entry['cell']}",
                }
            )
    return sample[:: max(1, len(sample) // count)][:count]


def compared() -> list[dict[str, Any]]:
    """One comparison of two policies that does not survive refinement, and one that does."""
    good, bad = [0.9, 1.0, 0.95, 1.0, 0.9], [0.1, 0.05, 0.2, 0.0, 0.1]

    def cells(coarse: list[float], fine: list[float], weak: list[float]) -> list[PolicyCell]:
        return [
            PolicyCell("explicit_euler dt=0.05", coarse, weak),
            PolicyCell("rk4 dt=0.0125", fine, weak, "quarter_step"),
            PolicyCell(TRUTH, fine, weak, "reference"),
        ]

    lost, won = cells(good, bad, [0.45, 0.5, 0.55, 0.6, 0.5]), cells(good, good, bad)
    return msgspec.to_builtins(
        [
            compare_policies(lost, a="explicit_euler dt=0.05", b="rk4 dt=0.05"),
            compare_policies(won, a="rk4 dt=0.05", b="implicit_euler dt=0.05"),
        ]
    )


def remedy(panel: dict[str, Any]) -> dict[str, Any]:
    """What a panel says about its mixture."""
    rate = {(e["row"], e["cell"]): e["success_by_seed"] for e in panel["matrix"]}
    singles = [r["name"] for r in panel["rows"] if r["home"] and r["learned"]]
    cells = []
    for place in panel["cells"]:
        if place["kind"] not in ("grid", "reference"):
            continue
        name = place["name"]
        mixed = rate["mixed steps", name]
        lost = [
            {
                "row": single,
                "overfitting": difference([0.95] * len(mixed), rate[single, name]),
                "difference": difference(mixed, rate[single, name]),
            }
            for single in singles
            if np.mean(rate[single, name]) < 0.7 and single != name
        ]
        cells.append(
            {
                "cell": name,
                "member": name in mixture(1)["shares"],
                "solved": place["integrator"] != "implicit_euler",
                "overfitting": difference([0.95] * len(mixed), mixed),
                "lost": lost,
            }
        )
    return {"row": "mixed steps", "singles": singles, "cells": cells}


def training_cost(median: float | None, seeds: int) -> dict[str, Any]:
    """What training one row cost; one seed never got there."""
    ends = {"low": median and 0.8 * median, "high": None, "level": 0.9375}
    return {
        "window": 100,
        "rate": 0.9,
        "by_seed": [*[median] * (seeds - 1), None],
        "reached": seeds - 1 if median else 0,
        "median": {"estimate": median, **ends},
    }
