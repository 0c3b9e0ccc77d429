"""Synthetic panels for tests of the report: plausible numbers, no simulation."""

from __future__ import annotations

import copy
import math
from dataclasses import asdict
from typing import Any

import numpy as np

from integ_gym.eval.statistics import mean_interval
from integ_gym.eval.verdict import (
    Comparison,
    PolicyCell,
    compare_policies,
    judge_family,
    reference_class,
)

SCHEMES = (
    "explicit_euler",
    "symplectic_euler",
    "rk4",
    "implicit_euler",
    "implicit_midpoint",
)
STEPS = (0.05, 0.025, 0.0125)
PERIOD = 0.05
EPISODES = 20
TRUTH = "reference dt=0.05"
PUMP = {"explicit_euler": 1.0, "implicit_euler": -1.6, "symplectic_euler": 0.05}
"""Energy that a scheme puts in at the coarsest step, in units of what a policy bears."""

HOSTILE = "<script>alert('x')</script>&\"'`{{ 7*7 }}$\\frac{"


REASONS = {
    "evaluation_error": "the simulation diverged at 6.85 s",
    "discretization_error": (
        "the same policy succeeds from the same start on its training discretization, but it "
        "never came within 0.2 rad of upright and was saturated in 31 % of the steps"
    ),
    "planning_error": "it never came within 0.2 rad of upright and was saturated in 3 % of the "
    "steps",
    "control_error": "it reached the goal at 4.1 s and left it at 6.3 s",
}
"""What a record says, by label."""


def cell(scheme: str, dt: float, period: float = PERIOD, **more: Any) -> dict[str, Any]:
    """One entry of ``cells``."""
    name = f"{scheme} dt={dt:g}"
    if period != PERIOD:
        name += f" control={period:g}"
    if more.get("perturbation"):
        name += f", {more['perturbation']}"
    return {
        "name": name,
        "engine": "native",
        "integrator": scheme,
        "dt": dt,
        "control_period": period,
        "kind": "grid",
        "perturbation": None,
        "role": None,
        **more,
    }


def interval(rates: list[float]) -> dict[str, float]:
    """A rough interval over seeds, inside [0, 1] and never degenerate."""
    mean = float(np.mean(rates))
    half = 2.0 * float(np.std(rates)) / math.sqrt(len(rates)) + 0.7 / (len(rates) + 2)
    low, high = max(0.0, mean - half), min(1.0, mean + half)
    return {"estimate": mean, "low": low, "high": high, "level": 0.95}


def difference(first: list[float], second: list[float]) -> dict[str, float]:
    """A rough interval for a difference of rates."""
    mean = float(np.mean(first) - np.mean(second))
    spread = math.hypot(float(np.std(first)), float(np.std(second)))
    half = 2.0 * spread / math.sqrt(len(first)) + 0.5 / (len(first) + 2)
    return {
        "estimate": mean,
        "low": max(-1.0, mean - half),
        "high": min(1.0, mean + half),
        "level": 0.95,
    }


def pumped(scheme: str, dt: float) -> float:
    """Energy error of a scheme in units of what a policy bears."""
    return PUMP.get(scheme, 0.0) * dt / STEPS[0]


def grid_cells(schemes: tuple[str, ...], steps: tuple[float, ...]) -> list[dict[str, Any]]:
    """Grid and reference."""
    cells = [cell(scheme, dt) for scheme in schemes for dt in steps]
    for entry in cells:
        if entry["dt"] == steps[-1] and len(steps) > 2:
            entry["role"] = "quarter_step"
    return [*cells, cell("reference", PERIOD, kind="reference", role="reference")]


def extra_cells() -> list[dict[str, Any]]:
    """Perturbations and the ladder whose control period follows the step."""
    cells = []
    for scheme in ("explicit_euler", "rk4"):
        for change in ("mass +20 %", "latency 50 ms"):
            cells.append(cell(scheme, PERIOD, kind="perturbation", perturbation=change))
    for change in ("mass +20 %", "latency 50 ms"):
        cells.append(cell("reference", PERIOD, kind="perturbation", perturbation=change))
    for scheme in ("explicit_euler", "symplectic_euler", "rk4", "implicit_euler"):
        for dt in STEPS[1:]:
            cells.append(cell(scheme, dt, dt, kind="ladder"))
    return cells


def row(
    name: str, kind: str, scheme: str | None, seeds: int, home: str | None = None
) -> dict[str, Any]:
    """One entry of ``rows``, without what the matrix decides."""
    trained = kind == "trained"
    return {
        "name": name,
        "kind": kind,
        "home": home,
        "shares": {} if home is None else {home: 1.0},
        "integrator": scheme,
        "dt": PERIOD if trained else None,
        "control_period": PERIOD,
        "seeds": seeds,
        "policies": [
            {
                "id": f"{name.replace(' ', '-')}-seed{seed}",
                "seed": seed,
                "hash": f"{abs(hash((kind, seed))) % 16**12:012x}",
                "file": f"policies/{kind}-{seed}.zip" if trained else None,
            }
            for seed in range(seeds)
        ],
        "home_success": None,
        "learned": None,
        "training_steps": 300_000 if trained else None,
    }


def skill(line: dict[str, Any], place: dict[str, Any]) -> float:
    """Success rate of a row in a cell, before noise."""
    if line["kind"] == "baseline":
        return {"random": 0.0, "zero": 0.0}.get(line["name"], 0.97)
    if line["integrator"] == "implicit_euler":
        return 0.02
    if len(line["shares"]) > 1:
        return 0.95 if place["integrator"] != "implicit_euler" else 0.03
    off = pumped(place["integrator"], place["dt"]) - pumped(line["integrator"], line["dt"] or 0.05)
    if place["control_period"] != PERIOD:
        off *= 0.7
    change = {"mass +20 %": 0.35, "latency 50 ms": 0.8}.get(place["perturbation"], 0.0)
    return 1.0 / (1.0 + math.exp(6.0 * (abs(off) + change - 0.95)))


def rates(line: dict[str, Any], place: dict[str, Any], rng: np.random.Generator) -> list[float]:
    """Success rate of every seed."""
    middle = skill(line, place)
    noisy = middle + (0.25 * middle * (1.0 - middle)) * 4.0 * rng.normal(size=line["seeds"])
    return [float(np.round(np.clip(rate, 0.0, 1.0) * EPISODES) / EPISODES) for rate in noisy]


def spread(middle: float, line: dict[str, Any], rng: np.random.Generator) -> Any:
    """Mean over seeds of a number that is no rate, as the panel stores it."""
    values = middle * (1.0 + 0.1 * rng.normal(size=line["seeds"]))
    found = mean_interval(values)
    if found is None:
        return {"estimate": float(values[0]), "low": None, "high": None, "level": 0.95}
    return asdict(found)


def matrix_entry(
    line: dict[str, Any], place: dict[str, Any], rng: np.random.Generator
) -> dict[str, Any]:
    """One entry of ``matrix``, without gaps and classes."""
    by_seed = rates(line, place, rng)
    episodes = EPISODES * line["seeds"]
    won = round(sum(by_seed) * EPISODES)
    diverged = 12 if place["integrator"] == "explicit_euler" and won < 10 else 0
    residual = 8.0 * pumped(place["integrator"], place["dt"]) + (
        2e-3 * (place["dt"] / 0.05) ** 2 if place["integrator"] != "reference" else 3e-12
    )
    cause = "discretization_error" if line["kind"] == "trained" else "planning_error"
    lost = episodes - won - diverged
    control = lost // 4
    labels = {
        "none": won,
        "evaluation_error": diverged,
        cause: lost - control,
        "control_error": control,
    }
    return {
        "row": line["name"],
        "cell": place["name"],
        "episodes": episodes,
        "success": interval(by_seed),
        "success_by_seed": by_seed,
        "return": spread(-40.0 - 100.0 * (1.0 - won / episodes), line, rng),
        "time_to_success": spread(3.4, line, rng) if won else None,
        "time_to_success_episodes": won,
        "energy_residual": spread(residual, line, rng),
        "energy_residual_abs": spread(abs(residual) * 1.2, line, rng),
        "diverged": diverged,
        "home_drop": None,
        "transfer_gap": None,
        "reference_class": None,
        "labels": {name: count for name, count in labels.items() if count},
        "file": f"evidence/eval-{line['name']}-{place['name']}.parquet".replace(" ", "_"),
        "query": (
            'integ-gym evidence query runs/panel "SELECT episode, success, failure_label '
            f"FROM evidence WHERE policy_row = '{line['name']}' AND cell = '{place['name']}'\""
        ),
    }


def complete(panel: dict[str, Any]) -> None:
    """Fill what follows from the success rates: home, gaps, classes, verdicts."""
    rate = {(e["row"], e["cell"]): e["success_by_seed"] for e in panel["matrix"]}
    cells = {c["name"]: c for c in panel["cells"]}
    native = {r["home"]: r for r in panel["rows"] if r["kind"] == "trained"}
    lines = {r["name"]: r for r in panel["rows"]}
    at_home = {line["name"]: home_rates(line, rate) for line in panel["rows"]}
    for line in panel["rows"]:
        if at_home[line["name"]] is not None:
            line["home_success"] = interval(at_home[line["name"]])
            line["learned"] = line["home_success"]["estimate"] >= 0.5
    for entry in panel["matrix"]:
        line, place, own = lines[entry["row"]], cells[entry["cell"]], entry["success_by_seed"]
        home = at_home[line["name"]]
        if home is not None:
            entry["home_drop"] = difference(home, own)
        other = native.get(entry["cell"])
        if other is not None and line["kind"] == "trained" and other["learned"]:
            entry["transfer_gap"] = difference(rate[other["name"], entry["cell"]], own)
        truth = rate.get((line["name"], TRUTH))
        if truth is not None and place["kind"] == "grid":
            entry["reference_class"] = reference_class(float(np.mean(own)), float(np.mean(truth)))


def home_rates(line: dict[str, Any], rate: dict[tuple[str, str], list[float]]) -> Any:
    """Success of every seed at home, by the shares of the cells; None where it is not known."""
    parts = [
        share * np.array(rate[line["name"], place])
        for place, share in line["shares"].items()
        if (line["name"], place) in rate
    ]
    return np.sum(parts, axis=0).tolist() if parts else None


def judge(panel: dict[str, Any], pairs: list[tuple[str, str]]) -> list[dict[str, Any]]:
    """Verdicts on a family of (row, cell)."""
    rate = {(e["row"], e["cell"]): e["success_by_seed"] for e in panel["matrix"]}
    lines = {r["name"]: r for r in panel["rows"]}
    native = {r["home"]: r["name"] for r in panel["rows"] if r["kind"] == "trained"}
    family = [
        Comparison(
            f"{line} on {place}",
            rate[line, lines[line]["home"]],
            rate.get((native.get(place, ""), place)),
            rate[line, place],
        )
        for line, place in pairs
    ]
    return [
        {**asdict(verdict), "row": line, "cell": place}
        for verdict, (line, place) in zip(judge_family(family), pairs, strict=True)
    ]


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

    return [
        {
            **asdict(compare_policies(cells(good, bad, [0.45, 0.5, 0.55, 0.6, 0.5]))),
            "a": "explicit_euler dt=0.05",
            "b": "rk4 dt=0.05",
        },
        {
            **asdict(compare_policies(cells(good, good, bad))),
            "a": "rk4 dt=0.05",
            "b": "implicit_euler dt=0.05",
        },
    ]


def base_panel(
    rows: list[dict[str, Any]], cells: list[dict[str, Any]], seed: int
) -> dict[str, Any]:
    """A panel of rows and cells with its matrix filled."""
    rng = np.random.default_rng(seed)
    skipped = {"perturbation", "ladder"}
    panel: dict[str, Any] = {
        "schema_version": 1,
        "name": "quick",
        "question": "Does a policy trained on one integrator survive another?",
        "answer": (
            "No: policies trained on explicit Euler at 0.05 s swing up in 98 % of the episodes at "
            "home and in 42 % on the continuous-time truth, while those trained on RK4 lose "
            "nothing."
        ),
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


def baselines(seeds: int) -> list[dict[str, Any]]:
    """The baselines of every panel."""
    return [row(name, "baseline", None, seeds) for name in ("random", "zero", "handmade")]


def trained(schemes: tuple[str, ...], seeds: int, dt: float = STEPS[0]) -> list[dict[str, Any]]:
    """One trained row for each scheme."""
    rows = []
    for scheme in schemes:
        home = f"{scheme} dt={dt:g}"
        rows.append({**row(home, "trained", scheme, seeds, home), "dt": dt})
    return rows


def mixture(seeds: int) -> dict[str, Any]:
    """A row trained on a mixture."""
    shares = {"explicit_euler dt=0.05": 0.25, "rk4 dt=0.05": 0.5, "rk4 dt=0.025": 0.25}
    return {**row("mixed steps", "trained", None, seeds), "shares": shares}


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
                "quantity": "home_drop",
                "gap": difference([0.95] * len(mixed), rate[single, name]),
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
                "quantity": "home_drop",
                "gap": difference([0.95] * len(mixed), mixed),
                "lost": lost,
            }
        )
    summary = "In 4 of the 15 discretizations that somebody solves, others lose; it keeps 3."
    return {"row": "mixed steps", "singles": singles, "cells": cells, "summary": summary}


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
        ],
    )
    panel["policy_comparisons"] = compared()
    panel["failures"] = failures(panel, 24)
    return panel


def given_panel() -> dict[str, Any]:
    """One given policy of one seed: no verdicts, no gaps."""
    rows = [row("my_policy.zip", "given", None, 1)]
    rows[0]["integrator"], rows[0]["dt"] = "explicit_euler", STEPS[0]
    panel = base_panel(rows, grid_cells(SCHEMES[:3], STEPS), 1)
    rows[0]["learned"] = None
    for entry in panel["matrix"]:
        entry["success"] = {**entry["success"], "low": None, "high": None}
    panel["warnings"] = ["The policy file names no training discretization."]
    panel["answer"] = "One policy was evaluated; one seed cannot tell a policy from its luck."
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
    keep = {"row", "cell", "episodes", "diverged"}
    for entry in panel["matrix"]:
        entry.update({name: None for name in entry if name not in keep})
    for line in panel["rows"]:
        line.update(home=None, integrator=None, dt=None, control_period=None)
        line.update(home_success=None, learned=None, training_steps=None, policies=[], shares=None)
    for place in panel["cells"]:
        place.update(dt=None, role=None)
    for judged in panel["verdicts"]:
        judged.update(p_exceeds=None, p_equivalent=None)
        judged.update(p_exceeds_adjusted=None, p_equivalent_adjusted=None)
    panel.update(remedies=None, training_costs=None)
    panel.update(spec={}, versions={}, cost={}, failures=[], policy_comparisons=[])
    panel.update(platform=None, created=None, command=None, answer=None, failures_total=None)
    return panel


def hostile_panel() -> dict[str, Any]:
    """Names, texts and paths that try to break out of the page or out of mathtext."""
    panel = copy.deepcopy(full_panel())

    def poison(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {name: poison(entry, name) for name, entry in value.items()}
        if isinstance(value, list):
            return [poison(entry, key) for entry in value]
        words = {"name", "row", "cell", "home", "reason", "question", "answer", "command", "a", "b"}
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
