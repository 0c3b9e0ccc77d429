"""Rows, cells and matrix entries of a synthetic panel: plausible numbers, no simulation."""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict
from typing import Any

import numpy as np

from integ_gym.eval.statistics.scalars import mean_interval
from integ_gym.eval.verdict.reference import reference_class

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
                "hash": hashlib.sha256(f"{kind} {seed}".encode()).hexdigest()[:12],
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
        "not_converged": 0,
        "home_drop": None,
        "transfer_gap": None,
        "reference_class": None,
        "labels": {name: count for name, count in labels.items() if count},
        "file": [f"evidence/eval-{line['name']}-{place['name']}.parquet".replace(" ", "_")],
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
