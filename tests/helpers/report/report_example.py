"""Synthetic panels for tests of the report: plausible numbers, no simulation."""

from __future__ import annotations

import copy
import hashlib
import math
from typing import Any

import msgspec
import numpy as np

from integ_gym.eval.power import Comparison, judge_family
from integ_gym.eval.statistics import mean_interval
from integ_gym.eval.verdict import (
    UNSOLVABLE,
    Achieved,
    Attempt,
    PolicyCell,
    Rates,
    Search,
    achieved,
    compare_policies,
    reference_class,
    split,
)

SCHEMES = ("explicit_euler", "symplectic_euler", "rk4", "implicit_euler", "implicit_midpoint")
STEPS = (0.05, 0.025, 0.0125)
PERIOD = 0.05
EPISODES = 20
TRUTH = "reference dt=0.05"
EULER, RK4, IMPLICIT = "explicit_euler dt=0.05", "rk4 dt=0.05", "implicit_euler dt=0.05"
HOSTILE = "<script>alert('x')</script>&\"'`{{ 7*7 }}$\\frac{"
CHANGES = {"mass +20 %": 0.35, "latency 50 ms": 0.8}
"""Variations, and what each takes of what a policy bears."""

CHANGED = {"mass +20 %": {"mass": 1.2}, "latency 50 ms": {"action_latency": 0.05}}
"""Arguments that they change."""

PUMP = {"explicit_euler": 1.0, "implicit_euler": -1.6, "symplectic_euler": 0.05}
"""Energy that a scheme puts in at the coarsest step, in units of what a policy bears."""

IMPOSSIBLE, SLOW, UNKNOWN = (f"implicit_euler dt={dt:g}" for dt in STEPS)
CEILING = {IMPOSSIBLE: (0.0, 0.0), SLOW: (0.3, 0.9), UNKNOWN: (0.3, 0.4)}
"""Success that nobody exceeds in a cell, within the horizon and within two."""

SEARCH = Search(20.0, 19.6, (14.2, 15.1, 13.8, 14.9), "a beam over controls")
"""What a search over controls reaches where the goal cannot be reached."""

SOLVABLE = ("achievability", "best", "search")
"""What a cell says of whether it can be solved."""

REASONS = {
    "evaluation_error": "the simulation diverged at 6.85 s.",
    "unachievable": (
        "a search over controls misses the goal's energy here from most starts, in twice the time "
        "too; it never came within 0.2 rad of upright."
    ),
    "not_learned": "the policy succeeds from 0 % of its starts at home.",
    "too_slow": "the same policy succeeds from the same start in twice the time",
    "discretization_error": (
        "the same policy succeeds from the same start on its training discretization, but it "
        "never came within 0.2 rad of upright and was saturated in 31 % of the steps"
    ),
    "planning_error": "it never came within 0.2 rad of upright",
    "control_error": "it reached the goal at 4.1 s and left it at 6.3 s",
}
"""What a record says, by label."""


def cell(scheme: str, dt: float, period: float = PERIOD, **more: Any) -> dict[str, Any]:
    """One entry of ``cells``."""
    name = f"{scheme} dt={dt:g}" + (f" control={period:g}" if period != PERIOD else "")
    place = {"engine": "native", "integrator": scheme, "dt": dt, "control_period": period}
    change = more.get("variation")
    if change:
        more = {**more, "at": name, "environment": CHANGED[change]}
    return {
        "name": ", ".join(filter(None, (name, change))),
        **place,
        "applied": {**place, "engine_version": "0.1.0", "substeps": max(1, round(period / dt))},
        "kind": "grid",
        "environment": {},
        **dict.fromkeys(("variation", "at", "role", *SOLVABLE)),
        **more,
    }


def grid_cells(schemes: tuple[str, ...], steps: tuple[float, ...]) -> list[dict[str, Any]]:
    """Grid and reference."""
    cells = [cell(scheme, dt) for scheme in schemes for dt in steps]
    for entry in cells:
        if entry["dt"] == steps[-1] and len(steps) > 2:
            entry["role"] = "quarter_step"
    return [*cells, cell("reference", PERIOD, kind="reference", role="reference")]


def extra_cells() -> list[dict[str, Any]]:
    """Variations and the ladder whose control period follows the step."""
    return [
        *(
            cell(scheme, PERIOD, kind="varied", variation=change)
            for scheme in ("explicit_euler", "rk4", "reference")
            for change in CHANGES
        ),
        *(cell(scheme, dt, dt, kind="ladder") for scheme in SCHEMES[:4] for dt in STEPS[1:]),
    ]


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


def baselines(seeds: int) -> list[dict[str, Any]]:
    """The baselines of every panel."""
    return [row(name, "baseline", None, seeds) for name in ("random", "zero", "handmade")]


def trained(schemes: tuple[str, ...], seeds: int, dt: float = STEPS[0]) -> list[dict[str, Any]]:
    """One trained row for each scheme."""
    homes = {f"{scheme} dt={dt:g}": scheme for scheme in schemes}
    return [{**row(h, "trained", scheme, seeds, h), "dt": dt} for h, scheme in homes.items()]


def mixture(seeds: int) -> dict[str, Any]:
    """A row trained on a mixture."""
    shares = {EULER: 0.25, RK4: 0.5, "rk4 dt=0.025": 0.25}
    return {**row("mixed steps", "trained", None, seeds), "shares": shares}


def interval(mean: float, half: float, low: float = -1.0) -> dict[str, float]:
    """A rough interval, cut at ``low`` and 1."""
    ends = {"low": max(low, mean - half), "high": min(1.0, mean + half)}
    return {"estimate": mean, **ends, "level": 0.95}


def rate_interval(rates: list[float]) -> dict[str, float]:
    """A rough interval over seeds, inside [0, 1] and never degenerate."""
    half = 2.0 * float(np.std(rates)) / math.sqrt(len(rates)) + 0.7 / (len(rates) + 2)
    return interval(float(np.mean(rates)), half, 0.0)


def difference(first: list[float], second: list[float]) -> dict[str, float]:
    """A rough interval for a difference of rates."""
    spread = math.hypot(float(np.std(first)), float(np.std(second)))
    half = 2.0 * spread / math.sqrt(len(first)) + 0.5 / (len(first) + 2)
    return interval(float(np.mean(first) - np.mean(second)), half)


def spread(middle: float, line: dict[str, Any], rng: np.random.Generator) -> Any:
    """Mean over seeds of a number that is no rate, as the panel stores it."""
    values = middle * (1.0 + 0.1 * rng.normal(size=line["seeds"]))
    found = mean_interval(values)
    if found is None:
        return {"estimate": float(values[0]), "low": None, "high": None, "level": 0.95}
    return msgspec.to_builtins(found)


def pumped(scheme: str, dt: float) -> float:
    """Energy error of a scheme in units of what a policy bears."""
    return PUMP.get(scheme, 0.0) * dt / STEPS[0]


def skill(line: dict[str, Any], place: dict[str, Any]) -> float:
    """Success rate of a row in a cell, before noise."""
    most, _ = CEILING.get(place["name"], (1.0, 1.0))
    if line["kind"] == "baseline":
        return min(most, 0.97 if line["name"] == "handmade" else 0.0)
    if line["integrator"] == "implicit_euler":
        return min(most, 0.02)
    if len(line["shares"]) > 1:
        return min(most, 0.95 if place["integrator"] != "implicit_euler" else 0.03)
    off = pumped(place["integrator"], place["dt"]) - pumped(line["integrator"], line["dt"] or 0.05)
    off *= 1.0 if place["control_period"] == PERIOD else 0.7
    change = CHANGES.get(place["variation"], 0.0)
    return min(most, 1.0 / (1.0 + math.exp(6.0 * (abs(off) + change - 0.95))))


def recovered_rates(place: str, own: list[float]) -> list[float]:
    """Success rate of every seed within two horizons, from that within one."""
    within, later = CEILING.get(place, (1.0, 1.0))
    again = [
        min(1.0, rate * later / within) if later > within else rate + 0.4 * rate * (1.0 - rate)
        for rate in own
    ]
    return [float(np.round(rate * EPISODES) / EPISODES) for rate in again]


def matrix_entry(
    line: dict[str, Any], place: dict[str, Any], rng: np.random.Generator
) -> dict[str, Any]:
    """One entry of ``matrix``, without gaps and classes."""
    middle = skill(line, place)
    noisy = middle + (0.25 * middle * (1.0 - middle)) * 4.0 * rng.normal(size=line["seeds"])
    by_seed = [float(np.round(np.clip(rate, 0.0, 1.0) * EPISODES) / EPISODES) for rate in noisy]
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
    labels = {"none": won, "evaluation_error": diverged, cause: lost - lost // 4}
    labels["control_error"] = lost // 4
    parts = ("home_drop", "difficulty", "deadline", "overfitting", "transfer_gap")
    return {
        "row": line["name"],
        "cell": place["name"],
        "episodes": episodes,
        "success": rate_interval(by_seed),
        "success_by_seed": by_seed,
        "recovered": rate_interval(recovered_rates(place["name"], by_seed)),
        "return": spread(-40.0 - 100.0 * (1.0 - won / episodes), line, rng),
        "time_to_success": spread(3.4, line, rng) if won else None,
        "time_to_success_episodes": won,
        "energy_residual": spread(residual, line, rng),
        "energy_residual_abs": spread(abs(residual) * 1.2, line, rng),
        "diverged": diverged,
        "not_converged": 0,
        **dict.fromkeys(parts),
        "reference_class": None,
        "labels": {name: count for name, count in labels.items() if count},
        "file": [f"evidence/eval-{line['name']}-{place['name']}.parquet".replace(" ", "_")],
        "query": (
            'integ-gym evidence query runs/panel "SELECT episode, success, failure_label '
            f"FROM evidence WHERE policy_row = '{line['name']}' AND cell = '{place['name']}'\""
        ),
    }


class Success:
    """Success of every seed in a panel's matrix, and what follows from it."""

    def __init__(self, panel: dict[str, Any]) -> None:
        self.rows = {line["name"]: line for line in panel["rows"]}
        self.rate = {(e["row"], e["cell"]): e["success_by_seed"] for e in panel["matrix"]}

    def home(self, row: str) -> list[float] | None:
        """By seed at home, by the shares of the cells; None where it is not known."""
        parts = [
            share * np.array(self.rate[row, place])
            for place, share in self.rows[row]["shares"].items()
            if (row, place) in self.rate
        ]
        return np.sum(parts, axis=0).tolist() if parts else None

    def yardsticks(self, place: str) -> dict[str | None, list[float]]:
        """By seed, of rows that show whether a cell can be solved; None: the controller's."""
        lines = self.rows.values()
        natives = [r["name"] for r in lines if r["kind"] == "trained" and r["home"] == place]
        found = {row: self.rate[row, place] for row in natives if (row, place) in self.rate}
        own = self.rate.get(("handmade", place))
        return found if own is None else {**found, None: own}

    def solvable(self, place: str) -> Achieved:
        """Whether a cell can be solved."""
        attempts = [
            Attempt(who, float(np.mean(own)), float(np.mean(recovered_rates(place, own))))
            for who, own in self.yardsticks(place).items()
        ]
        return achieved(attempts, SEARCH if attempts and place == IMPOSSIBLE else None)

    def rates(self, row: str, place: str) -> Rates | None:
        """What the loss of a row in a cell is made of; None without a home."""
        home, own = self.home(row), self.rate[row, place]
        if home is None:
            return None
        later = {who: recovered_rates(place, x) for who, x in self.yardsticks(place).items()}
        starts = [
            float(start < round(mean * EPISODES))
            for mean in later.pop(None, [])
            for start in range(EPISODES)
        ]
        natives = next(iter(later.values()), None)
        natives = None if self.rows[row]["home"] == place else natives
        return Rates(home, own, recovered_rates(place, own), natives, starts or None)


def base_panel(
    rows: list[dict[str, Any]], cells: list[dict[str, Any]], seed: int
) -> dict[str, Any]:
    """A panel of rows and cells with its matrix filled."""
    rng = np.random.default_rng(seed)
    matrix = [
        matrix_entry(line, place, rng)
        for line in rows
        for place in cells
        if place["kind"] not in ("varied", "ladder") or line["kind"] == "trained"
    ]
    panel: dict[str, Any] = {
        "schema_version": 7,
        "name": "quick",
        "question": "Does a policy trained on one integrator survive another?",
        "spec": {
            "env_id": "IntegPendulum-v0",
            "environment": {"max_torque": 0.8, "start": "hanging", "duration": 10.0},
            "control_period": PERIOD,
            "training": {"algorithm": "ppo", "total_steps": 300_000, "learning_rate": 1e-3},
            "episodes": EPISODES,
            "seeds": [0, 1, 2, 3, 4],
            "family": [[EULER, TRUTH]],
            "variations": [
                {"name": name, "changes": changes, "at": ["home", "truth"]}
                for name, changes in CHANGED.items()
            ],
        },
        "units": {"action_latency": "s"},
        "versions": {"integ-gym": "0.1.0", "gymnasium": "1.2.0", "numpy": "2.4.6"},
        "created": "2026-11-21T12:00:00Z",
        "platform": "Linux-6.1-x86_64",
        "cost": {
            "wall_seconds": 611.0, "train_seconds": 900.0, "evaluate_seconds": 80.0, "workers": 2,
        },
        "command": "integ-gym panel specs/quick.toml --out runs/panel",
        "directory": "runs/panel",
        "rows": rows,
        "cells": cells,
        "matrix": matrix,
        **{name: [] for name in ("verdicts", "policy_comparisons", "failures")},
        "failures_total": sum(
            count for e in matrix for name, count in e["labels"].items() if name != "none"
        ),
    }  # fmt: skip
    _complete(panel)
    return panel


def _complete(panel: dict[str, Any]) -> None:
    """Fill what follows from the success rates: home, losses, gaps, classes, what can be solved."""
    success = Success(panel)
    cells = {c["name"]: c for c in panel["cells"]}
    for line in panel["rows"]:
        at_home = success.home(line["name"])
        if at_home is not None:
            line["home_success"] = rate_interval(at_home)
            line["learned"] = line["home_success"]["estimate"] >= 0.5
    natives = {r["home"]: r for r in panel["rows"] if r["kind"] == "trained" and r["learned"]}
    for place in panel["cells"]:
        if place["kind"] in ("grid", "reference"):
            can = msgspec.to_builtins(success.solvable(place["name"]))
            place.update(achievability=can["status"], best=can["best"], search=can["search"])
    for entry in panel["matrix"]:
        line, place = success.rows[entry["row"]], cells[entry["cell"]]
        own, made_of = entry["success_by_seed"], success.rates(entry["row"], entry["cell"])
        if made_of is not None and line["home"] != place["name"]:
            found = split(made_of, draws=500)  # few: nothing is concluded from them
            parts = msgspec.to_builtins(found)
            entry.update(home_drop=parts.pop("total"), **parts)
        native = natives.get(entry["cell"])
        if native is not None and line["kind"] == "trained":
            entry["transfer_gap"] = difference(success.rate[native["name"], entry["cell"]], own)
        truth = success.rate.get((line["name"], TRUTH))
        in_time = place["achievability"] not in UNSOLVABLE
        if truth is not None and place["kind"] == "grid" and in_time:
            entry["reference_class"] = reference_class(float(np.mean(own)), float(np.mean(truth)))


def judge(panel: dict[str, Any], pairs: list[tuple[str, str]]) -> list[dict[str, Any]]:
    """Verdicts on a family of (row, cell)."""
    success, family = Success(panel), []
    for line, place in pairs:
        rates = success.rates(line, place)
        assert rates is not None
        family.append(Comparison(line, place, rates, success.solvable(place)))
    return msgspec.to_builtins(list(judge_family(family, draws=20_000)))  # none of them is close


def failures(panel: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """A sample of failing episodes."""
    sample = []
    rows = {line["name"] for line in panel["rows"] if line["kind"] != "baseline"}
    for number, entry in enumerate(panel["matrix"]):
        labels = [name for name in entry["labels"] if name != "none"]
        if entry["row"] in rows and labels:
            one = {
                "row": entry["row"],
                "cell": entry["cell"],
                "policy": f"{entry['row'].replace(' ', '-')}-seed{number % 5}",
                "episode_index": number % EPISODES,
                "record_id": f"{(number * 2654435761) % 16**16:016x}",
                "label": labels[0],
                "reason": f"{REASONS[labels[0]]} on {entry['cell']}",
            }
            sample.append(one)
    return sample[:: max(1, len(sample) // count)][:count]


def compared() -> list[dict[str, Any]]:
    """One comparison of two policies that does not survive refinement, and one that does."""
    good, bad = [0.9, 1.0, 0.95, 1.0, 0.9], [0.1, 0.05, 0.2, 0.0, 0.1]
    middle = [0.45, 0.5, 0.55, 0.6, 0.5]
    return [
        msgspec.to_builtins(
            compare_policies(
                [
                    PolicyCell(EULER, good, weak),
                    PolicyCell("rk4 dt=0.0125", fine, weak, "quarter_step"),
                    PolicyCell(TRUTH, fine, weak, "reference"),
                ],
                a=a,
                b=b,
            )
        )
        for fine, weak, a, b in ((bad, middle, EULER, RK4), (good, bad, RK4, IMPLICIT))
    ]


def remedy(panel: dict[str, Any]) -> dict[str, Any]:
    """What a panel says about its mixture."""
    rate = Success(panel).rate
    singles = [r["name"] for r in panel["rows"] if r["home"] and r["learned"]]
    names = [p["name"] for p in panel["cells"] if p["kind"] in ("grid", "reference")]
    cells = [
        {
            "cell": name,
            "member": name in mixture(1)["shares"],
            "solved": not name.startswith("implicit_euler"),
            "overfitting": difference([0.95] * len(mixed), mixed),
            "lost": [
                {
                    "row": single,
                    "overfitting": difference([0.95] * len(mixed), rate[single, name]),
                    "difference": difference(mixed, rate[single, name]),
                }
                for single in singles
                if np.mean(rate[single, name]) < 0.7 and single != name
            ],
        }
        for name in names
        for mixed in [rate["mixed steps", name]]
    ]
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


def full_panel(seeds: int = 5, seed: int = 0) -> dict[str, Any]:
    """Everything a panel can hold."""
    schemes = (*SCHEMES[:4], "reference")
    rows = [*trained(schemes, seeds), mixture(seeds), *baselines(seeds)]
    panel = base_panel(rows, [*grid_cells(SCHEMES, STEPS), *extra_cells()], seed)
    panel["remedies"] = [remedy(panel)]
    panel["training_costs"] = {
        line["name"]: training_cost(None if "implicit" in line["name"] else 161_400.0, seeds)
        for line in rows
        if line["kind"] == "trained"
    }
    to_truth = [(name, TRUTH) for name in (EULER, "symplectic_euler dt=0.05", RK4)]
    to_others = [(RK4, place) for place in (IMPOSSIBLE, SLOW, UNKNOWN)]
    panel["verdicts"] = judge(panel, [*to_truth, (TRUTH, EULER), (IMPLICIT, TRUTH), *to_others])
    panel["policy_comparisons"] = compared()
    panel["failures"] = failures(panel, 24)
    return panel


def every_verdict_panel() -> dict[str, Any]:
    """Seeds enough for every verdict, and cells of every kind."""
    rows = [*trained(("explicit_euler", "rk4", "implicit_euler", "reference"), 48), *baselines(48)]
    panel = base_panel(rows, grid_cells(("explicit_euler", "rk4", "implicit_euler"), STEPS), 4)
    pairs = [(EULER, TRUTH), (RK4, TRUTH), (EULER, "explicit_euler dt=0.0125"), (IMPLICIT, TRUTH)]
    panel["verdicts"] = judge(panel, [*pairs, *((RK4, at) for at in (IMPOSSIBLE, SLOW, UNKNOWN))])
    return panel


def build_given_panel() -> dict[str, Any]:
    """One given policy of one seed: no verdicts, no gaps; every fifth return is not finite."""
    rows = [row("my_policy.zip", "given", None, 1)]
    rows[0]["integrator"], rows[0]["dt"] = "explicit_euler", STEPS[0]
    panel = base_panel(rows, grid_cells(SCHEMES[:3], STEPS), 1)
    panel["paired"] = []
    for place, entry in enumerate(panel["matrix"]):
        entry["success"] = {**entry["success"], "low": None, "high": None}
        share, finite = (place % 7 - 2) / 5.0, place % 5 > 0
        ends = {"low": max(share - 0.15, -1.0), "high": min(share + 0.1, 1.0), "level": 0.95}
        earned = {"low": 900.0 * share - 50.0, "high": 900.0 * share + 60.0, "level": 0.95}
        one = {
            "row": "my_policy.zip",
            "cell": entry["cell"],
            "against": "truth",
            "scope": "this policy, these starts",
            "episodes": 40,
            "success": {"estimate": share, **ends},
            "p_success": 0.0004 if share else 1.0,
            "p_success_adjusted": 0.012 if share else 1.0,
            "returns": {"estimate": 900.0 * share, **earned} if finite else None,
            "p_return": 0.002 if finite else None,
            "p_return_adjusted": 0.06 if finite else None,
        }
        panel["paired"].append(one)
    panel["doubts"] = ["The policy file names no training discretization."]
    return panel


def nothing_learned_panel() -> dict[str, Any]:
    """Trained rows of which none reached a home success of one half."""
    rows = [*trained(("implicit_euler",), 5), *baselines(5)]
    panel = base_panel(rows, grid_cells(SCHEMES[:2] + SCHEMES[3:4], STEPS), 2)
    panel["verdicts"] = judge(panel, [(IMPLICIT, TRUTH)])
    return panel


def none_panel() -> dict[str, Any]:
    """The full panel with null wherever null is allowed, and what may be empty empty."""
    panel = full_panel(seeds=2)
    unbounded = dict.fromkeys(("low", "high", "level"))
    parts = ("difficulty", "deadline", "overfitting")
    measured = ("return", "time_to_success", "energy_residual", "energy_residual_abs")
    for entry in panel["matrix"]:
        entry.update(dict.fromkeys((*measured, *parts, "home_drop", "transfer_gap")))
        entry.update(reference_class=None, labels={}, file=[], success_by_seed=[])
        entry["success"] |= unbounded
        entry["recovered"] |= unbounded
    of_row = ("home", "integrator", "dt", "control_period", "home_success", "learned")
    for line in panel["rows"]:
        line.update(dict.fromkeys((*of_row, "training_steps")), policies=[], shares={})
    for place in panel["cells"]:
        place.update(dict.fromkeys(("role", *SOLVABLE)))
    for judged in panel["verdicts"]:
        judged.update(dict.fromkeys(name for name in judged if name.startswith("p_")))
        for part in ("total", *parts):
            judged[part] |= unbounded
    variations = {"variations": panel["spec"]["variations"]}
    panel.update(remedies=[], training_costs={}, spec=variations, versions={})
    panel.update(failures=[], failures_total=0, policy_comparisons=[])
    return panel


def hostile_panel() -> dict[str, Any]:
    """Names, texts and paths that try to break out of the page or out of mathtext."""
    words = {
        "name", "row", "cell", "home", "reason", "question", "command", "a", "b",
        "integrator", "variation", "record_id", "query", "platform", "id", "singles",
    }  # fmt: skip

    def poison(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {name: poison(entry, name) for name, entry in value.items()}
        if isinstance(value, list):
            return [poison(entry, key) for entry in value]
        return f"{value}{HOSTILE}" if isinstance(value, str) and key in words else value

    panel = poison(copy.deepcopy(full_panel()))
    for entry in panel["matrix"]:
        entry["file"] = ["javascript:alert(1)", "//evil.example/x", 'a" onclick="alert(1)']
        entry["labels"] = {HOSTILE: 3, **entry["labels"]}
    panel["spec"][HOSTILE] = HOSTILE
    return panel
