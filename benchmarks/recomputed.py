"""Error rates over looks, verdicts and closed loops, recomputed without the package.

    python benchmarks/recomputed.py looks [--repeats 2000]
    python benchmarks/recomputed.py verdicts RUN
    python benchmarks/recomputed.py loops RUN

Imports nothing of the package: what is here was written from `docs/explanation/verdicts.md` and
`docs/reference/environments.md` with numpy, scipy and pyarrow. RUN is a finished directory of the
quick panel; its `panel.json`, `evidence/` and `policies/` are read.

``looks``: how often a verdict is wrong at any of several looks at a run that grows, with and
without the level being spent over them. ``verdicts``: every verdict of the declared family from
the records. ``loops``: what the spectral radius of closed loops says of failures, in all cells and
in those that can be won.
"""

from __future__ import annotations

import argparse
import json
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow.parquet as pq
from scipy.integrate import solve_ivp
from scipy.stats import binom, rankdata

Array = npt.NDArray[np.float64]

ALPHA, FAIL_MARGIN, MARGIN = 0.05, 0.2, 0.1
LEAST, LEAST_EQUIVALENCE, LEAST_PLANNED = 5, 33, 30
HOME_SHARE = 0.9


def share(number: int) -> float:
    """Of the level, what look ``number`` has: 3/4, 1/8, 1/16, …"""
    return 0.75 if number == 1 else 0.25 * 0.5 ** (number - 1)


def share_at(looks: Sequence[int], now: int, least: int) -> float:
    """The same where looks with fewer than ``least`` seeds spend nothing."""
    if looks[now] < least:
        return 0.0
    return share(1 + sum(seeds >= least for seeds in looks[:now]))


def share_planned(looks: Sequence[int], now: int, least: int) -> float:
    """The same where all looks were planned: equal shares of those with enough seeds."""
    return 1.0 / sum(seeds >= least for seeds in looks) if looks[now] >= least else 0.0


# --- verdicts, from docs/explanation/verdicts.md -------------------------------------------------


def means(rng: np.random.Generator, columns: Array, worst: Sequence[float], weight: float,
          draws: int) -> Array:  # fmt: skip
    """Dirichlet-weighted means of columns (seeds, quantities), one pseudo-seed at the worst."""
    weights = rng.standard_exponential((draws, len(columns)))
    pseudo = rng.standard_gamma(weight, (draws, 1))
    total = weights.sum(axis=1, keepdims=True) + pseudo
    return np.asarray((weights @ columns + pseudo * np.asarray(worst)) / total)


def share_of(contradicting: npt.NDArray[np.bool_]) -> float:
    return float((contradicting.sum() + 1) / (contradicting.size + 1))


def p_exceeds(rng: np.random.Generator, row: Array, yardsticks: Sequence[Array], margin: float,
              weight: float, draws: int) -> float:  # fmt: skip
    """ "overfitting > margin", row of shape (seeds, 2): home, and success within two horizons."""
    drawn = means(rng, row, (0.0, 1.0), weight, draws)
    home, recovered = drawn.T
    own = share_of(home - recovered <= margin)
    others = [
        share_of(means(rng, one[:, None], (0.0,), weight, draws)[:, 0] - recovered <= margin)
        for one in yardsticks
    ]
    return max(own, min(1.0, len(others) * min(others))) if others else own


def p_below(rng: np.random.Generator, row: Array, yardsticks: Sequence[Array], margin: float,
            draws: int) -> float:  # fmt: skip
    """ "overfitting < margin"."""
    home, recovered = means(rng, row, (1.0, 0.0), 1.0, draws).T
    others = [
        share_of(means(rng, one[:, None], (1.0,), 1.0, draws)[:, 0] - recovered >= margin)
        for one in yardsticks
    ]
    own = share_of(home - recovered >= margin) / HOME_SHARE
    return min(1.0, own, max(others) / (1.0 - HOME_SHARE) if others else 1.0)


def p_within(rng: np.random.Generator, row: Array, yardsticks: Sequence[Array], margin: float,
             draws: int) -> float:  # fmt: skip
    return max(
        p_below(rng, row, yardsticks, margin, draws),
        p_exceeds(rng, row, yardsticks, -margin, 1.0, draws),
    )


def holm(p: Sequence[float]) -> Array:
    order = np.argsort(p)
    stepped = np.maximum.accumulate(np.asarray(p)[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted


def verdicts(run: Path) -> None:
    """Print every verdict of the declared family, recomputed, beside what panel.json says."""
    panel = json.loads((run / "panel.json").read_text(encoding="utf-8"))
    columns = ["policy_id", "cell", "phase", "episode_index", "success", "replay_second_horizon"]
    table = pq.read_table(run / "evidence", columns=columns).to_pandas()
    table = table[table.phase == "evaluation"]
    policies = {row["name"]: [one["id"] for one in row["policies"]] for row in panel["rows"]}
    rows = {row["name"]: row for row in panel["rows"]}
    cells = {cell["name"]: cell for cell in panel["cells"]}
    outcome = dict(iter(table.groupby(["policy_id", "cell"])))

    def rates(row: str, cell: str, later: bool) -> Array:
        found = []
        for policy in policies[row]:
            group = outcome[policy, cell]
            won = group.success.astype(bool)
            if later:
                won = won | group.replay_second_horizon.fillna(False).astype(bool)
            found.append(won.mean())
        return np.array(found)

    rng = np.random.default_rng(1)
    looks = [look["seeds"] for look in panel["looks"]]
    judged: list[tuple[Any, str | None, float, float, Array]] = []
    for saved in panel["verdicts"]:
        row, cell = saved["row"], saved["cell"]
        home = sum(part * rates(row, own, False) for own, part in rows[row]["shares"].items())
        recovered = rates(row, cell, True)
        yardsticks = []
        if cell in rows and cell != row:
            yardsticks.append(rates(cell, cell, True))
        handmade = sorted((run / "units").glob("achieve-*.json"))
        for file in handmade:
            unit = json.loads(file.read_text(encoding="utf-8"))
            if unit["cell"] == cell and unit["recovered"]:
                yardsticks.append(np.asarray(unit["recovered"], dtype=np.float64))
        reach = min(home.mean(), max((one.mean() for one in yardsticks), default=1.0))
        overfitting = reach - recovered.mean()
        status = cells[cell]["achievability"]
        mark = "not_learned" if home.mean() < 0.5 else None if status == "achievable" else status
        pair = np.stack([home, recovered], axis=1)
        judged.append((
            saved, mark,
            p_exceeds(rng, pair, yardsticks, FAIL_MARGIN, 0.6, 200_000),
            p_within(rng, pair, yardsticks, MARGIN, 200_000), overfitting,
        ))  # fmt: skip
    tested = [one for one in judged if one[1] is None]
    untold = [1.0 for one in judged if one[1] == "undecided"]
    now = len(looks) - 1
    spent = share_at(looks, now, LEAST), share_at(looks, now, LEAST_EQUIVALENCE)
    corrected = [
        [min(1.0, p / part) if part else 1.0 for p in holm([*[o[k] for o in tested], *untold])]
        for k, part in ((2, spent[0]), (3, spent[1]))
    ]
    for place, (saved, _, _, _, overfitting) in enumerate(tested):
        exceeds, within = corrected[0][place], corrected[1][place]
        verdict = "fails" if exceeds < ALPHA else "transfers" if within < ALPHA else "inconclusive"
        print(
            f"{saved['row']} → {saved['cell']}: {verdict}, overfitting {overfitting:.4f}, adjusted "
            f"p {exceeds:.4f} and {within:.4f}\n  panel.json: {saved['verdict']}, "
            f"{saved['overfitting']['estimate']:.4f}, {saved['p_exceeds_adjusted']:.4f} and "
            f"{saved['p_equivalent_adjusted']:.4f}"
        )
    for saved, mark, *_ in judged:
        if mark is not None:
            print(f"{saved['row']} → {saved['cell']}: {mark}\n  panel.json: {saved['verdict']}")


# --- looks ---------------------------------------------------------------------------------------

Draw = Callable[[np.random.Generator, float, int], Array]

WORLDS: dict[str, Draw] = {
    "all or nothing": lambda rng, mean, seeds: (rng.random(seeds) < mean).astype(np.float64),
    "smooth": lambda rng, mean, seeds: (
        rng.beta(10.0 * mean, 10.0 * (1.0 - mean), seeds) if mean < 1.0 else np.ones(seeds)
    ),
    "mixed": lambda rng, mean, seeds: np.where(
        rng.random(seeds) < 0.5 * (1.0 - mean),
        0.0,
        WORLDS["smooth"](rng, mean / (0.5 * (1.0 + mean)), seeds),
    ),
}
PLANS = ((42,), (42, 52), (30, 42, 52, 64), (10, 23, 36, 49, 62, 75, 88, 100))


def exact(looks: Sequence[int], shares: Sequence[float], overfitting: float = MARGIN) -> float:
    """Chance of `transfers` at any look, all or nothing, yardsticks perfect, exactly.

    Then the test of equivalence is the binomial one: with f of n seeds lost its p-value is
    P(Bin(n, 0.1) ≤ f) / 0.9. At an overfitting of 0.1 the verdict is wrong.
    """
    lost, before, wrong = np.array([1.0]), 0, 0.0
    for now, seeds in enumerate(looks):
        more = seeds - before
        lost = np.convolve(lost, binom.pmf(np.arange(more + 1), more, overfitting))
        level = ALPHA * shares[now]
        shown = binom.cdf(np.arange(seeds + 1), seeds, MARGIN) / HOME_SHARE < level
        wrong += float(lost[shown].sum())
        lost[shown] = 0.0
        before = seeds
    return wrong


def worst_case(most: int, looks: int) -> float:
    """The same, exactly, where the next look is chosen with all outcomes before it in view."""
    chances = [binom.pmf(np.arange(d + 1), d, MARGIN) for d in range(most + 1)]
    shown = [binom.cdf(np.arange(n + 1), n, MARGIN) / HOME_SHARE for n in range(most + 1)]
    later = [np.zeros(n + 1) for n in range(most + 1)]
    for number in range(looks, 0, -1):
        level = ALPHA * share(number)
        seen = [
            np.where((shown[n] < level) & (n >= LEAST_EQUIVALENCE), 1.0, later[n])
            for n in range(most + 1)
        ]
        if number == 1:
            return max(float(chances[n] @ seen[n]) for n in range(LEAST_EQUIVALENCE, most + 1))
        later = [np.zeros(n + 1) for n in range(most + 1)]
        for n in range(LEAST_EQUIVALENCE, most):
            for m in range(n + 1, most + 1):
                gained = np.convolve(seen[m], chances[m - n][::-1])[m - n : m + 1]
                np.maximum(later[n], gained, out=later[n])
    raise AssertionError("expected at least one look")


def simulated(
    rng: np.random.Generator, draw: Draw, fails: bool, looks: Sequence[int], repeats: int
) -> tuple[float, float]:
    """Share of runs with a wrong verdict at any look: without spending, and with.

    `fails` is wrong at a true overfitting of exactly 0.2, `transfers` at 0.1. 20 starts a seed;
    policies and natives always succeed at home, and so does a hand-made controller.
    """
    wrong = np.zeros((repeats, 2), dtype=bool)
    for k in range(repeats):
        there = rng.binomial(20, draw(rng, 0.8 if fails else 0.9, looks[-1])) / 20
        for now, seeds in enumerate(looks):
            row = np.stack([np.ones(seeds), there[:seeds]], axis=1)
            yardsticks = [np.ones(seeds), np.ones(100)]
            if fails:
                p = p_exceeds(rng, row, yardsticks, FAIL_MARGIN, 0.6, 2000)
            else:
                p = p_within(rng, row, yardsticks, MARGIN, 2000)
            part = share_at(looks, now, LEAST if fails else LEAST_EQUIVALENCE)
            wrong[k] |= (p < ALPHA, p < ALPHA * part)
    one, other = wrong.mean(axis=0)
    return float(one), float(other)


def shares_of(looks: Sequence[int]) -> list[list[float]]:
    """Shares of the level that looks have: the whole, as unplanned ones, as planned ones."""
    places = range(len(looks))
    return [
        [1.0 for _ in places],
        [share_at(looks, now, LEAST_EQUIVALENCE) for now in places],
        [share_planned(looks, now, LEAST_PLANNED) for now in places],
    ]


def looks_told(repeats: int) -> None:
    """Print chances of wrong verdicts over looks."""
    print("`transfers`, all or nothing, exact: without shares, unplanned looks, planned looks")
    for overfitting in (MARGIN, 0.02):
        for looks in ((31,), *PLANS):
            rates = ", ".join(f"{exact(looks, one, overfitting):.4f}" for one in shares_of(looks))
            print(f"  overfitting {overfitting}, looks at {looks}: {rates}")
    print(f"  four looks chosen by the outcomes, up to 120 seeds: {worst_case(120, 4):.4f}")
    rng = np.random.default_rng(0)
    print(f"simulated, {repeats} runs each: as it was, spent")
    for verdict in ("transfers", "fails"):
        for name, draw in WORLDS.items():
            for looks in PLANS[2:]:
                one, other = simulated(rng, draw, verdict == "fails", looks, repeats)
                print(f"  `{verdict}`, {name}, looks at {looks}: {one:.4f}, {other:.4f}")


# --- closed loops, from docs/reference/environments.md -------------------------------------------

GRAVITY, INERTIA, PERIOD, GOAL = 15.0, 1.0 / 3.0, 0.05, 0.2
"""3 g / (2 l), s^-2, and m l^2 / 3, kg m^2, of the rod; s; rad."""


def slope(state: Array, torque: Array) -> Array:
    return np.stack([state[..., 1], GRAVITY * np.sin(state[..., 0]) + torque / INERTIA], axis=-1)


def explicit_euler(state: Array, torque: Array, h: float) -> Array:
    return state + h * slope(state, torque)


def symplectic_euler(state: Array, torque: Array, h: float) -> Array:
    speed = state[..., 1] + h * slope(state, torque)[..., 1]
    return np.stack([state[..., 0] + h * speed, speed], axis=-1)


def rk4(state: Array, torque: Array, h: float) -> Array:
    one = slope(state, torque)
    two = slope(state + 0.5 * h * one, torque)
    three = slope(state + 0.5 * h * two, torque)
    four = slope(state + h * three, torque)
    return np.asarray(state + h / 6.0 * (one + 2.0 * two + 2.0 * three + four))


def implicit_euler(state: Array, torque: Array, h: float) -> Array:
    angle, speed = state[..., 0], state[..., 1]
    later = speed
    for _ in range(30):
        at = angle + h * later
        missed = later - speed - h * (GRAVITY * np.sin(at) + torque / INERTIA)
        later = later - missed / (1.0 - h * h * GRAVITY * np.cos(at))
    return np.stack([angle + h * later, later], axis=-1)


def reference(state: Array, torque: Array, h: float) -> Array:
    """RK4 in 25 steps, whose error is below 1e-10 here."""
    for _ in range(25):
        state = rk4(state, torque, h / 25)
    return state


STEPS = {one.__name__: one for one in
         (explicit_euler, symplectic_euler, rk4, implicit_euler, reference)}  # fmt: skip


def network(file: Path) -> dict[str, Array]:
    """Arrays of a safetensors file: length, a JSON header, then the data."""
    content = file.read_bytes()
    (size,) = struct.unpack("<Q", content[:8])
    header = json.loads(content[8 : 8 + size])
    arrays = {}
    for name, about in header.items():
        if name != "__metadata__":
            start, end = (8 + size + place for place in about["data_offsets"])
            arrays[name] = np.frombuffer(content[start:end], "<f4").reshape(about["shape"])
    return {name: array.astype(np.float64) for name, array in arrays.items()}


def radii(run: Path, row: dict[str, Any], cell: dict[str, Any]) -> Array:
    """Spectral radius of each policy's loop about its fixed point next to upright, or NaN."""
    layers = [
        network(run / "policies" / one["id"] / "policy.safetensors") for one in row["policies"]
    ]
    held = {name: np.stack([one[name] for one in layers]) for name in layers[0]}
    last = sum(name.endswith("weight") for name in held) - 1
    step, parts = STEPS[cell["integrator"]], round(PERIOD / cell["dt"])

    def advance(states: Array) -> Array:
        """Shape (policies, points, 2) to the same, one control period later."""
        angle, speed = states[..., 0], states[..., 1]
        x = np.stack([np.cos(angle), np.sin(angle), speed], axis=-1)
        for k in range(last + 1):
            x = x @ held[f"actor.{k}.weight"].transpose(0, 2, 1) + held[f"actor.{k}.bias"][:, None]
            x = np.tanh(x) if k < last else x
        torque = np.clip(x[..., 0], held["actions.low"], held["actions.high"])
        for _ in range(parts):
            states = step(states, torque, PERIOD / parts)
        return states

    at = np.zeros((len(layers), 1, 2))
    for _ in range(300):
        at = advance(at)
    near = np.isfinite(at).all(axis=-1) & (np.abs(at[..., 0]) < GOAL)
    at = np.where(near[..., None], at, 0.0)
    offsets = 1e-6 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    for _ in range(12):
        after = advance(at + offsets)
        jacobian = np.stack([(after[:, 1] - after[:, 2]), (after[:, 3] - after[:, 4])], -1) / 2e-6
        missed, here = after[:, 0] - at[:, 0], at
        correction = np.linalg.pinv(np.eye(2) - jacobian) @ missed[..., None]
        at = np.clip(at + correction.transpose(0, 2, 1), -1.0, 1.0)
    found = (np.abs(missed).max(axis=-1) < 1e-6) & (np.abs(here[:, 0, 0]) < GOAL)
    return np.where(found, np.abs(np.linalg.eigvals(jacobian)).max(axis=-1), np.nan)


def area(values: Array, failed: npt.NDArray[np.bool_]) -> float:
    """Chance that a failure has the larger value of a failure and a success (Mann-Whitney)."""
    known = np.isfinite(values)
    ranks, lost = rankdata(values[known]), failed[known]
    n = int(lost.sum())
    return float((ranks[lost].sum() - n * (n + 1) / 2) / (n * (lost.size - n)))


def loops(run: Path) -> None:
    """Print what the spectral radius says of failures."""
    check_reference()
    panel = json.loads((run / "panel.json").read_text(encoding="utf-8"))
    entries = {(one["row"], one["cell"]): one for one in panel["matrix"]}
    cells = [one for one in panel["cells"] if one["kind"] in ("grid", "reference")]
    found = []
    for row in panel["rows"]:
        if row["kind"] == "trained" and row["learned"]:
            for cell in cells:
                success = np.array(entries[row["name"], cell["name"]]["success_by_seed"])
                for radius, rate in zip(radii(run, row, cell), success, strict=True):
                    found.append((cell["name"], cell["achievability"], radius, rate < 0.5))
    names, status, radius, failed = (np.array(column) for column in zip(*found, strict=True))
    parts = {
        "all cells": np.ones(len(names), dtype=bool),
        "cells that can be won": status == "achievable",
        "the truth": np.char.startswith(names, "reference"),
    }
    for name, part in parts.items():
        stable = part & (radius < 1.0)
        print(
            f"{name}: {int(part.sum())} loops, {int(stable.sum())} stable, of which "
            f"{int((stable & failed).sum())} fail; area {area(radius[part], failed[part]):.2f}"
        )


def check_reference() -> None:
    """Hold the small steps that stand for the truth against DOP853."""
    start, torque = np.array([0.3, 1.5]), np.array(0.5)
    exact_end = solve_ivp(lambda _, y: slope(y, torque), (0.0, PERIOD), start, "DOP853",
                          rtol=1e-13, atol=1e-13).y[:, -1]  # fmt: skip
    assert np.abs(reference(start, torque, PERIOD) - exact_end).max() < 1e-10


def main() -> None:
    """Recompute and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    what = parser.add_subparsers(dest="what", required=True)
    what.add_parser("looks").add_argument("--repeats", type=int, default=1000)
    for name in ("verdicts", "loops"):
        what.add_parser(name).add_argument("run", type=Path)
    given = parser.parse_args()
    if given.what == "looks":
        looks_told(given.repeats)
    else:
        {"verdicts": verdicts, "loops": loops}[given.what](given.run)


if __name__ == "__main__":
    main()
