"""Rows, cells and matrix entries of a synthetic panel: plausible numbers, no simulation."""

from __future__ import annotations

import hashlib
import math
from typing import Any

import msgspec
import numpy as np

from integ_gym.eval.statistics import mean_interval
from integ_gym.eval.verdict import (
    UNSOLVABLE,
    Achieved,
    Attempt,
    Rates,
    Search,
    achieved,
    reference_class,
    split,
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

CHANGES = {"mass +20 %": {"mass": 1.2}, "latency 50 ms": {"action_latency": 0.05}}
"""What perturbations change."""

DRAWS = 500
"""Draws of an interval of the matrix: few, because nothing is concluded from it."""

IMPOSSIBLE, SLOW, UNKNOWN = (f"implicit_euler dt={dt:g}" for dt in STEPS)
CEILING = {IMPOSSIBLE: (0.0, 0.0), SLOW: (0.3, 0.9), UNKNOWN: (0.3, 0.4)}
"""Success that nobody exceeds in a cell, within the horizon and within two."""

SEARCH = Search(20.0, 19.6, (14.2, 15.1, 13.8, 14.9), "a beam over controls")
"""What a search over controls reaches where the goal cannot be reached."""


def cell(scheme: str, dt: float, period: float = PERIOD, **more: Any) -> dict[str, Any]:
    """One entry of ``cells``."""
    name = f"{scheme} dt={dt:g}"
    if period != PERIOD:
        name += f" control={period:g}"
    change = more.get("perturbation")
    changed = change and {"name": change, "environment": CHANGES[change]}
    if change:
        name += f", {change}"
    place = {"engine": "native", "integrator": scheme, "dt": dt, "control_period": period}
    return {
        "name": name,
        **place,
        "applied": {**place, "engine_version": "0.1.0", "substeps": max(1, round(period / dt))},
        "kind": "grid",
        "perturbation": None,
        "role": None,
        "achievability": None,
        **more,
        **({"perturbation": changed} if changed else {}),
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
    most, _ = CEILING.get(place["name"], (1.0, 1.0))
    return min(most, unbounded_skill(line, place))


def unbounded_skill(line: dict[str, Any], place: dict[str, Any]) -> float:
    """The same if every cell could be solved in time."""
    if line["kind"] == "baseline":
        return {"random": 0.0, "zero": 0.0}.get(line["name"], 0.97)
    if line["integrator"] == "implicit_euler":
        return 0.02
    if len(line["shares"]) > 1:
        return 0.95 if place["integrator"] != "implicit_euler" else 0.03
    off = pumped(place["integrator"], place["dt"]) - pumped(line["integrator"], line["dt"] or 0.05)
    if place["control_period"] != PERIOD:
        off *= 0.7
    changed = place["perturbation"] and place["perturbation"]["name"]
    change = {"mass +20 %": 0.35, "latency 50 ms": 0.8}.get(changed, 0.0)
    return 1.0 / (1.0 + math.exp(6.0 * (abs(off) + change - 0.95)))


def rates(line: dict[str, Any], place: dict[str, Any], rng: np.random.Generator) -> list[float]:
    """Success rate of every seed."""
    middle = skill(line, place)
    noisy = middle + (0.25 * middle * (1.0 - middle)) * 4.0 * rng.normal(size=line["seeds"])
    return [float(np.round(np.clip(rate, 0.0, 1.0) * EPISODES) / EPISODES) for rate in noisy]


def recovered_rates(place: dict[str, Any], own: list[float]) -> list[float]:
    """Success rate of every seed within two horizons, from that within one."""
    within, later = CEILING.get(place["name"], (1.0, 1.0))
    if later > within:
        again = [min(1.0, rate * later / within) for rate in own]
    else:
        again = [rate + 0.4 * rate * (1.0 - rate) for rate in own]
    return [float(np.round(rate * EPISODES) / EPISODES) for rate in again]


def spread(middle: float, line: dict[str, Any], rng: np.random.Generator) -> Any:
    """Mean over seeds of a number that is no rate, as the panel stores it."""
    values = middle * (1.0 + 0.1 * rng.normal(size=line["seeds"]))
    found = mean_interval(values)
    if found is None:
        return {"estimate": float(values[0]), "low": None, "high": None, "level": 0.95}
    return msgspec.to_builtins(found)


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
    cause = {IMPOSSIBLE: "unachievable", SLOW: "too_slow"}.get(place["name"], cause)
    if line["integrator"] == "implicit_euler" and place["name"] != IMPOSSIBLE:
        cause = "not_learned"
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
        "recovered": interval(recovered_rates(place, by_seed)),
        "return": spread(-40.0 - 100.0 * (1.0 - won / episodes), line, rng),
        "time_to_success": spread(3.4, line, rng) if won else None,
        "time_to_success_episodes": won,
        "energy_residual": spread(residual, line, rng),
        "energy_residual_abs": spread(abs(residual) * 1.2, line, rng),
        "diverged": diverged,
        "not_converged": 0,
        "home_drop": None,
        "difficulty": None,
        "deadline": None,
        "overfitting": None,
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
    """Fill what follows from the success rates: home, losses, gaps, classes, what can be solved."""
    rate = rates_of(panel)
    cells = {c["name"]: c for c in panel["cells"]}
    native = {r["home"]: r for r in panel["rows"] if r["kind"] == "trained"}
    lines = {r["name"]: r for r in panel["rows"]}
    for line in panel["rows"]:
        at_home = home_rates(line, rate)
        if at_home is not None:
            line["home_success"] = interval(at_home)
            line["learned"] = line["home_success"]["estimate"] >= 0.5
    for place in panel["cells"]:
        if place["kind"] in ("grid", "reference"):
            can = solvable(panel, place["name"])
            can = msgspec.to_builtins(can)
            place.update(achievability=can["status"], best=can["best"], search=can["search"])
    for entry in panel["matrix"]:
        line, place, own = lines[entry["row"]], cells[entry["cell"]], entry["success_by_seed"]
        made_of = loss_rates(panel, line["name"], place["name"])
        if made_of is not None and line["home"] != place["name"]:
            parts = msgspec.to_builtins(split(made_of, draws=DRAWS))
            entry.update(home_drop=parts.pop("total"), **parts)
        other = native.get(entry["cell"])
        if other is not None and line["kind"] == "trained" and other["learned"]:
            entry["transfer_gap"] = difference(rate[other["name"], entry["cell"]], own)
        truth = rate.get((line["name"], TRUTH))
        in_time = place["achievability"] not in UNSOLVABLE
        if truth is not None and place["kind"] == "grid" and in_time:
            entry["reference_class"] = reference_class(float(np.mean(own)), float(np.mean(truth)))


def rates_of(panel: dict[str, Any]) -> dict[tuple[str, str], list[float]]:
    """Success of every seed, by row and cell."""
    return {(e["row"], e["cell"]): e["success_by_seed"] for e in panel["matrix"]}


def yardsticks(panel: dict[str, Any], place: str) -> dict[str | None, list[float]]:
    """Success of every seed of those who show whether a cell can be solved, by row.

    Under None, that of the hand-made controller.
    """
    rate = rates_of(panel)
    natives = [r["name"] for r in panel["rows"] if r["kind"] == "trained" and r["home"] == place]
    found = {row: rate[row, place] for row in natives if (row, place) in rate}
    own = rate.get(("handmade", place))
    return found if own is None else {**found, None: own}


def solvable(panel: dict[str, Any], name: str) -> Achieved:
    """Whether a cell can be solved."""
    place = {"name": name}
    attempts = [
        Attempt(who, float(np.mean(own)), float(np.mean(recovered_rates(place, own))))
        for who, own in yardsticks(panel, name).items()
    ]
    return achieved(attempts, SEARCH if attempts and name == IMPOSSIBLE else None)


def loss_rates(panel: dict[str, Any], row: str, name: str) -> Rates | None:
    """What the loss of a row in a cell is made of; None without a home."""
    line = next(r for r in panel["rows"] if r["name"] == row)
    rate, place = rates_of(panel), {"name": name}
    home = home_rates(line, rate)
    if home is None:
        return None
    own, others = rate[row, name], yardsticks(panel, name)
    later = {who: recovered_rates(place, found) for who, found in others.items()}
    starts = [
        float(start < round(mean * EPISODES))
        for mean in later.pop(None, [])
        for start in range(EPISODES)
    ]
    return Rates(
        home,
        own,
        recovered_rates(place, own),
        None if line["home"] == name else next(iter(later.values()), None),
        starts or None,
    )


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
