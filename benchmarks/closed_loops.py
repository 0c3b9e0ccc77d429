"""What tells which policies fail: the stability of their closed loops, or how they arrive?

    python benchmarks/closed_loops.py RUN [--json FILE]

RUN is the directory of a finished pendulum panel. Of every policy of a row that learned, in every
cell of the matrix that can be won, the map of one control period (observe, decide, integrate) is
linearised about its fixed point next to upright, by central differences; the loop is stable where
the spectral radius is below 1. Of every episode with a trace, the speed at the first arrival at the
goal is taken, and the share of the energy gained until then that the numerics gave. Each is then
asked how well it tells failures from successes: the area under the ROC curve, 0.5 for a coin
and 1 for certainty, larger values meaning failure, with a 95 % bootstrap interval over seeds.
Cells that no control is known to solve (`achievability` other than `achievable`) are left out: a
failure there says nothing about the policy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from measuring import results
from scipy.stats import rankdata
from tqdm import tqdm

from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.eval.panel.cells import Cell, environments_of
from integ_gym.eval.panel.cells import Cell as Place
from integ_gym.eval.panel.result import FILE_NAME, Panel, Row, read_panel
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy import PolicyStack
from integ_gym.train.policy_files.sidecar import read_trained, readable_file

Array = npt.NDArray[np.float64]

STEP = 1e-5
"""Of the central differences, rad and rad/s."""

NEWTON = 12

FLOAT32 = 1e-6
"""What a fixed point may be missed by: networks compute in float32."""

SETTLING = 300
"""Control periods for which a loop is let run before its fixed point is sought."""

GOAL = 0.2
"""Angle from upright that counts as the goal, rad."""

DRAWS = 400


def spectral_radii(panel: Panel, directory: Path, row: Row, cell: Cell) -> Array:
    """Of the closed loop of each policy of a row, shape (seeds,); NaN without a fixed point."""
    stack = PolicyStack(
        [read_trained(readable_file(directory / "policies" / p.id))[0] for p in row.policies]
    )
    home = Discretization(cell.integrator, cell.dt, cell.control_period, cell.engine)
    testbed = find_testbed(panel.spec["env_id"], panel.spec["environment"])
    environments = environments_of(testbed, Place.of(home, "grid"), 5 * row.seeds)

    def advanced(states: Array) -> Array:
        """Shape (seeds, 5, 2) to the same, one control period later."""
        seen, _ = environments.reset(options={"state": states.reshape(-1, 2)})
        actions = stack.act(seen.reshape(row.seeds, 5, -1))
        environments.step(actions.reshape(environments.action_space.shape))
        return np.stack(environments.state_components, axis=-1).reshape(states.shape)

    fixed, jacobian, missed = _fixed_points(advanced, row.seeds)
    environments.close()
    radii = np.abs(np.linalg.eigvals(jacobian)).max(axis=1)
    found = (missed < FLOAT32) & (np.abs(fixed[:, 0]) < GOAL)
    return np.where(found, radii, np.nan)


def _fixed_points(advanced: Callable[[Array], Array], seeds: int) -> tuple[Array, Array, Array]:
    """Fixed points (seeds, 2) of the maps, their Jacobians (seeds, 2, 2), what they miss by."""
    offsets = STEP * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]], dtype=np.float64)
    states = np.zeros((seeds, 5, 2))
    for _ in range(SETTLING):  # to where loops come to rest that are let go upright
        states = advanced(states)
    near = np.isfinite(states[:, 0]).all(axis=1) & (np.abs(states[:, 0, 0]) < GOAL)
    state = np.where(near[:, None], states[:, 0], 0.0)  # upright, of those that leave
    for _ in range(NEWTON):
        after = advanced(state[:, None] + offsets)
        columns = [(after[:, 2 * k + 1] - after[:, 2 * k + 2]) / (2 * STEP) for k in (0, 1)]
        jacobian = np.stack(columns, axis=-1)
        missed = after[:, 0] - state
        found, known = state, jacobian
        inverse = np.linalg.pinv(np.eye(2) - jacobian)
        state = np.clip(state + np.einsum("nij,nj->ni", inverse, missed), -1.0, 1.0)
    return found, known, np.abs(missed).max(axis=1)


def arrivals(directory: Path, cells: list[str], policies: list[str]) -> list[dict[str, Any]]:
    """Episodes with a trace that reach the goal: policy, success, speed and share of numerics."""
    table = EvidenceStore(directory / "evidence").query(
        "SELECT policy_id, success, theta, theta_dot, energy, energy_residual FROM records "
        "WHERE phase = 'evaluation' AND len(theta) > 0 AND "
        f"cell IN ({_listed(cells)}) AND policy_id IN ({_listed(policies)})"
    )
    return [found for record in table.to_pylist() if (found := _arrival(record)) is not None]


def _arrival(record: dict[str, Any]) -> dict[str, Any] | None:
    angle = np.asarray(record["theta"], dtype=np.float64)
    there = np.abs((angle + np.pi) % (2 * np.pi) - np.pi) < GOAL
    if not there.any():
        return None
    first = int(there.argmax())
    energy = np.asarray(record["energy"])
    gained = float(energy[first] - energy[0])
    given = float(np.sum(record["energy_residual"][:first]))
    return {
        "policy": record["policy_id"],
        "failed": not record["success"],
        "speed": abs(float(record["theta_dot"][first])),
        "share": given / gained if gained > 0.0 else float("nan"),
    }


def _listed(names: list[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)


def roc_area(values: Array, failed: npt.NDArray[np.bool_]) -> float:
    """Chance that a failure has the larger value of a failure and a success."""
    failures = int(failed.sum())
    successes = failed.size - failures
    if not failures or not successes:
        return float("nan")
    above = rankdata(values)[failed].sum() - failures * (failures + 1) / 2
    return float(above / (failures * successes))


def summary_of(name: str, values: Array, failed: Array, groups: npt.NDArray[Any]) -> dict[str, Any]:
    """How well a number tells failures, with its interval and its middle half in both."""
    known = np.isfinite(values)
    values, failed, groups = values[known], failed[known].astype(bool), groups[known]
    rng, seeds = np.random.default_rng(0), np.unique(groups)
    places = {seed: np.flatnonzero(groups == seed) for seed in seeds}
    drawn = []
    for _ in range(DRAWS):
        chosen = np.concatenate([places[s] for s in rng.choice(seeds, size=len(seeds))])
        drawn.append(roc_area(values[chosen], failed[chosen]))
    low, high = np.nanquantile(drawn, [0.025, 0.975])
    return {
        "number": name,
        "cases": int(failed.size),
        "failed": int(failed.sum()),
        "area": roc_area(values, failed),
        "low": float(low),
        "high": float(high),
        "of successes": [float(x) for x in np.quantile(values[~failed], [0.25, 0.5, 0.75])],
        "of failures": [float(x) for x in np.quantile(values[failed], [0.25, 0.5, 0.75])],
    }


def loops(panel: Panel, directory: Path, cells: list[Cell]) -> Iterator[dict[str, Any]]:
    """Spectral radius and success of every policy in every cell."""
    rows = [row for row in panel.rows if row.kind == "trained" and row.learned]
    plan = [(row, cell) for row in rows for cell in cells]
    for row, cell in tqdm(plan, unit=" loops"):
        entry = panel.entry(row.name, cell.name)
        assert entry is not None
        radii = spectral_radii(panel, directory, row, cell)
        for policy, radius, success in zip(row.policies, radii, entry.success_by_seed, strict=True):
            yield {
                "seed": policy.seed,
                "radius": float(radius),
                "failed": success < 0.5,
                "truth": cell.reference,
            }


def main() -> None:
    """Measure and print."""
    parser = results.parser(__doc__, file=True)
    parser.add_argument("run", type=Path, help="directory of a finished pendulum panel")
    given = parser.parse_args()
    panel = read_panel(given.run / FILE_NAME)
    cells = [cell for cell in panel.columns if cell.achievability == "achievable"]
    left_out = [cell.name for cell in panel.columns if cell not in cells]
    measured = list(loops(panel, given.run, cells))
    radius = np.array([one["radius"] for one in measured])
    failed = np.array([one["failed"] for one in measured])
    truth = np.array([one["truth"] for one in measured])
    of = np.array([one["seed"] for one in measured])
    stable = radius < 1.0
    print(
        f"{len(measured)} closed loops in {len(cells)} cells (left out, for they cannot be won: "
        f"{', '.join(left_out) or 'none'}): {int(np.isnan(radius).sum())} have no fixed point near "
        f"upright, {int(stable.sum())} are stable; of these {int((stable & failed).sum())} fail "
        f"(success below 0.5), of the others {int((~stable & failed).sum())}."
    )
    seed_of = {p.id: p.seed for row in panel.rows if row.learned for p in row.policies}
    episodes = arrivals(given.run, [cell.name for cell in cells], list(seed_of))
    seeds = np.array([seed_of[one["policy"]] for one in episodes])
    lost = np.array([one["failed"] for one in episodes])
    rows = [
        summary_of("spectral radius", radius, failed, of),
        summary_of("spectral radius, on the truth", radius[truth], failed[truth], of[truth]),
        summary_of(
            "arrival speed, rad/s", np.array([one["speed"] for one in episodes]), lost, seeds
        ),
        summary_of("numerics' share", np.array([one["share"] for one in episodes]), lost, seeds),
    ]
    results.print_table(
        ("number", "cases", "failed", "ROC area", "interval", "of successes", "of failures"),
        [
            (
                row["number"], str(row["cases"]), str(row["failed"]), f"{row['area']:.2f}",
                f"{row['low']:.2f} to {row['high']:.2f}",
                *("{1:.2f} ({0:.2f} to {2:.2f})".format(*row[of]) for of in
                  ("of successes", "of failures")),
            )
            for row in rows
        ],
    )  # fmt: skip
    results.write(given.json, {"numbers": rows}, ["numpy", "scipy", "integ-gym"])


if __name__ == "__main__":
    main()
