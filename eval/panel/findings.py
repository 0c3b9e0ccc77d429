"""Findings beside the matrix: engines, paired episodes, rankings, remedies and training costs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.engines.stepping import is_engine, map_of
from integ_gym.envs.ops.ops import Array
from integ_gym.envs.plants.interface import Plant
from integ_gym.envs.registries import ENGINES, TRUTH
from integ_gym.envs.settings import NATIVE, Discretization
from integ_gym.evidence.store import EvidenceStore

from .. import statistics as stats
from ..verdict import FAIL_MARGIN, UNSOLVED, Loss, adjust_for_look, share_of_look
from . import result
from .cells import Cell, axes_between, changes_name
from .conclusions import RETURN_MARGIN
from .limit import order_of, widen
from .matrix import Matrix, PanelLayout
from .spec import PanelSpec

VARIANTS = {
    "symplectic_euler_implicit_damping": "symplectic_euler",
    "symplectic_euler_implicit_velocity": "symplectic_euler",
    "symplectic_euler_sequential_damping": "symplectic_euler",
}
"""Maps that differ from one of ours by how they take forces of the velocity, to that one; without
such forces both are the same."""

SAME = 1e-9
"""Largest difference of two steps that are the same map's."""

EVALUATED_ONCE = ("explicit_euler", "symplectic_euler")
"""Of our integrators, those to which a force held from a step's start is the force itself."""


def twin_of(cell: Cell, cells: Mapping[str, Cell], plant: Plant, resisted: bool) -> str | None:
    """The native cell with an engine's cell's map, step and control period, or None.

    Args:
        cell: on a foreign engine.
        cells: all cells by name.
        plant: whose damping and Coriolis forces tell apart what is the same map without them.
        resisted: whether stops or friction act; no native cell holds their force over a step as
            most engines do, but for those that evaluate forces once.
    """
    own = cell.discretization
    if not is_engine(own.engine):
        return None
    wanted = map_of(own.engine, own.integrator)
    ours = VARIANTS.get(wanted, wanted)
    if ours != wanted and not _same_steps(ours, wanted, plant, own.dt):
        return None
    if resisted and ENGINES.load(own.engine).holds_resistance and ours not in EVALUATED_ONCE:
        return None
    twin = Discretization(ours, own.dt, own.control_period), cell.kind
    same = (name for name, one in cells.items() if (one.discretization, one.kind) == twin)
    return next(same, None)


def _same_steps(first: str, second: str, plant: Plant, dt: float) -> bool:
    cases = numerics.cases_of(plant, controlled=True)
    steps = [
        [numerics.mapped(name, plant, dt, 1, case) for case in cases] for name in (first, second)
    ]
    return max(map(numerics.largest_error, *steps)) < SAME


def agreements(
    layout: PanelLayout, matrix: Matrix, spec: PanelSpec
) -> tuple[result.EngineAgreement, ...]:
    """Every grid cell on a foreign engine beside its native twin.

    Args:
        layout: cells and rows.
        matrix: episodes of every row in every cell.
        spec: of the panel, whose plant has stops or friction, or has not.
    """
    cells = layout.cells
    foreign = [one for one in cells.values() if one.kind == "grid" and one.engine != NATIVE]
    if not foreign or spec.reference is None:
        return ()
    plant, steep = spec.nominal.plant, spec.nominal.system.steep
    twins = ((cell, twin_of(cell, cells, plant, steep)) for cell in foreign)
    return tuple(_agreement(cell, twin, layout, matrix) for cell, twin in twins)


def _agreement(
    cell: Cell, twin: str | None, layout: PanelLayout, matrix: Matrix
) -> result.EngineAgreement:
    rows = [row.name for row in layout.rows]
    here = [matrix.values(row, cell.name, "success") for row in rows]
    there = [] if twin is None else [matrix.values(row, twin, "success") for row in rows]
    pairs = list(zip(here, there, strict=False))
    return result.EngineAgreement(
        cell=cell.name,
        **cell.discretization.arguments(),
        map=map_of(cell.engine, cell.integrator),
        twin=twin,
        episodes=sum(values.size for values in here),
        success=_mean(here),
        twin_success=_mean(there) if there else None,
        differing=int(sum((a != b).sum() for a, b in pairs)) if pairs else None,
        largest=float(max(abs(a.mean() - b.mean()) for a, b in pairs)) if pairs else None,
    )


def _mean(values: Sequence[Any]) -> float:
    return float(np.concatenate([v.ravel() for v in values]).mean())


def limits(layout: PanelLayout, matrix: Matrix) -> tuple[result.Limit, ...]:
    """What every row reaches at the limit at each of its control periods."""
    return tuple(
        matrix.limit(row.name, *_of_limit(layout, matrix, row.name, steps))
        for steps in layout.limit_steps()
        for row in layout.rows
    )


def _of_limit(
    layout: PanelLayout, matrix: Matrix, row: str, steps: Sequence[str]
) -> tuple[Sequence[str], int, float]:
    """Steps and order of a limit, and by how much a return there may change for a row."""
    order, lead = order_of(layout.cells[steps[-1]].discretization), 0.0
    if "random" in matrix.rows:
        own, chance = (matrix.values(name, steps[-1], "return") for name in (row, "random"))
        lead = float(own.mean() - chance.mean())
    return steps, order, RETURN_MARGIN * lead if lead > 0.0 else math.inf


def paired_episodes(
    layout: PanelLayout, matrix: Matrix, called: Sequence[str] = ()
) -> tuple[result.PairedEpisodes, ...]:
    """What every given policy does in each cell, beside home; beside the truth without a home.

    Args:
        layout: rows and cells.
        matrix: their outcomes.
        called: cells that are called a limit; the others are taken as they are.
    """
    given = [row for row in layout.rows if row.kind == "given"]
    return tuple(found for row in given for found in _pair_row(layout, matrix, row, called))


def _pair_row(
    layout: PanelLayout, matrix: Matrix, row: result.Row, called: Sequence[str]
) -> Iterator[result.PairedEpisodes]:
    cells = layout.cells_of[row.name]
    against, shares = _compare_row(layout, matrix, row, called)
    if against is None:
        return
    at = {
        steps[-1]: matrix.at_limit(row.name, *_of_limit(layout, matrix, row.name, steps))
        for steps in layout.limit_steps()
        if steps[-1] in called
    }
    tested = [
        cell
        for cell in cells
        if (layout.cells[cell].kind != "limit" or layout.cells[cell].column)
        and (cell not in shares or len(shares) > 1)
        and (row.name, cell) not in layout.broken
    ]
    base = at[called[0]] if against == "limit" else None
    success = base.success[0] if base else _average_cells(matrix, row.name, "success", shares)
    earned = base.returns[0] if base else _average_cells(matrix, row.name, "return", shares)
    rates, means = [], []
    for cell in tested:
        found = at.get(cell)
        limited = [one for one in (base, found) if one is not None]
        here = found.success[0] if found else matrix.values(row.name, cell, "success")[0]
        rate = stats.paired_success(success, here)
        if limited:
            slack = sum(one.success_slack for one in limited)
            least = stats.paired_success(success, _nearer(success, here, slack))[1]
            rate = _beyond_slack(*rate, slack, least)
        rates.append(rate)
        here = found.returns[0] if found else matrix.values(row.name, cell, "return")[0]
        mean = _return(earned, here)
        if mean and limited:
            slack = math.copysign(sum(one.return_slack for one in limited), mean[0].estimate)
            shifted = _return(earned, here + slack)
            mean = shifted and _beyond_slack(*mean, abs(slack), shifted[1], math.inf)
        means.append(mean)
    share = share_of_look(max(1, len(layout.looks)))
    adjusted = [adjust_for_look(p, share) for p in stats.holm([p for _, p in rates]).tolist()]
    known = [p for found in means if found for p in found[1:]]
    corrected = iter(stats.holm(known).tolist())
    for cell, (interval, p), own, p_adjusted in zip(tested, rates, means, adjusted, strict=True):
        yield result.PairedEpisodes(
            row=row.name,
            cell=cell,
            against=against,
            episodes=len(success),
            success=interval,
            p_success=p,
            p_success_adjusted=p_adjusted,
            returns=own and own[0],
            p_return=own and own[1],
            p_return_adjusted=own and adjust_for_look(next(corrected), share),
        )


def _nearer(there: Array, here: Array, share: float) -> Array:
    """Success here if a share of the episodes ended as there, of those that make the difference."""
    apart = (there - here) * np.sign(np.sum(there - here))
    most = np.argsort(-apart, kind="stable")[: round(share * len(apart))]
    nearer = here.copy()
    nearer[most] = np.where(apart[most] > 0.0, there[most], here[most])
    return nearer


def _beyond_slack(
    lost: stats.Estimate, p: float, slack: float, least: float, most: float = 1.0
) -> tuple[stats.Estimate, float]:
    """A difference with a slack on either side; within it there is nothing to show.

    Args:
        lost: the difference.
        p: its p-value.
        slack: by how much it may be another.
        least: p-value of the difference less the slack.
        most: bound of the difference.
    """
    wide: stats.Estimate = widen(lost, slack, -most, most)
    return wide, 1.0 if wide.ends[0] <= 0.0 <= wide.ends[1] else max(p, least)


def _compare_row(
    layout: PanelLayout, matrix: Matrix, row: result.Row, called: Sequence[str]
) -> tuple[result.Against | None, dict[str, float]]:
    """What a row is held against, as shares of cells; None where there is nothing."""
    if row.shares and all(matrix.has(row.name, cell) for cell in row.shares):
        return "home", row.shares
    if layout.reference is not None:
        return "truth", {layout.reference: 1.0}
    return ("limit", {called[0]: 1.0}) if called else (None, {})


def _average_cells(matrix: Matrix, row: str, name: str, shares: dict[str, float]) -> Array:
    """One column by start, averaged over cells by their shares."""
    parts = [share * matrix.values(row, cell, name)[0] for cell, share in shares.items()]
    mean: Array = np.sum(parts, axis=0)
    return np.clip(mean, 0.0, 1.0) if name == "success" else mean


def _return(there: Array, here: Array) -> tuple[stats.Estimate, float] | None:
    """Difference of mean returns and its p-value; None where a return is not finite."""
    if not (np.isfinite(there).all() and np.isfinite(here).all()):
        return None
    interval, p = stats.paired_return(there, here)
    return interval or stats.Estimate(float(np.mean(there - here))), p


FEWEST = 5
"""Policies below which nothing is said of their ranking."""


def rankings(layout: PanelLayout, matrix: Matrix) -> tuple[result.RankingAgreement, ...]:
    """Agreement of every column's ranking of the trained policies with the truth's."""
    truth = layout.reference
    rows = [row for row in layout.rows if row.kind == "trained"]
    if truth is None or sum(len(row.policies) for row in rows) < FEWEST:
        return ()
    broken = {cell for _, cell in layout.broken}
    cells = (cell for cell in layout.columns() if cell != truth and cell not in broken)
    return tuple(_ranking(matrix, rows, cell, truth) for cell in cells)


def _ranking(
    matrix: Matrix, rows: list[result.Row], cell: str, truth: str
) -> result.RankingAgreement:
    here = {row.name: matrix.rates(row.name, cell) for row in rows}
    there = {row.name: matrix.rates(row.name, truth) for row in rows}
    seeds = np.concatenate([np.arange(len(rates)) for rates in here.values()])
    correlation, violation = stats.ranking_intervals(
        np.concatenate(list(here.values())), np.concatenate(list(there.values())), seeds
    )
    chosen = max(here, key=lambda name: float(here[name].mean()))
    best = max(there, key=lambda name: float(there[name].mean()))
    return result.RankingAgreement(
        cell=cell,
        policies=len(seeds),
        correlation=correlation,
        violation=violation,
        chosen=chosen,
        best=best,
        regret=float(there[best].mean() - there[chosen].mean()),
    )


Losses = Mapping[tuple[str, str], Loss]
"""By row and cell."""


def remedies(layout: PanelLayout, matrix: Matrix, losses: Losses) -> tuple[result.Remedy, ...]:
    """One entry per mixture: its loss in every column, beside that of single discretizations.

    Only rows of a single discretization that learned are held against it. In every column
    ``lost`` lists those among them, trained elsewhere, whose overfitting is estimated above 0.2.
    Everything here is exploratory.
    """
    singles = [
        row.name
        for row in layout.rows
        if row.kind == "trained" and row.home is not None and matrix.learned(row.name)
    ]
    mixtures = [row.name for row in layout.rows if row.kind == "trained" and len(row.shares) > 1]
    return tuple(
        result.Remedy(
            row=mixture,
            singles=tuple(singles),
            cells=tuple(
                _remedy_in(matrix, losses, mixture, singles, cell)
                for cell in layout.columns()
                if not any((row, cell) in layout.broken for row in (mixture, *singles))
            ),
        )
        for mixture in mixtures
    )


def _remedy_in(
    matrix: Matrix, losses: Losses, mixture: str, singles: Sequence[str], cell: str
) -> result.RemedyCell:
    rates = {row: matrix.rates(row, cell) for row in matrix.rows}
    return result.RemedyCell(
        cell=cell,
        member=cell in matrix.rows[mixture].shares,
        solved=any(bool(own.mean() >= UNSOLVED) for own in rates.values()),
        overfitting=losses[mixture, cell].overfitting,
        lost=tuple(
            result.RemedyLoss(
                row=row,
                overfitting=losses[row, cell].overfitting,
                difference=stats.unpaired_difference(rates[mixture], rates[row]).interval,
            )
            for row in singles
            if matrix.rows[row].home != cell
            and losses[row, cell].overfitting.estimate > FAIL_MARGIN
        ),
    )


def separations(layout: PanelLayout, matrix: Matrix) -> tuple[result.Separation, ...]:
    """What each difference costs each trained or given row in cells that differ from its home."""
    rows = [row for row in layout.rows if row.home is not None]
    return tuple(one for row in rows for one in _separations_of(layout, matrix, row))


def _separations_of(
    layout: PanelLayout, matrix: Matrix, row: result.Row
) -> Iterator[result.Separation]:
    """Of one row, whose cells are found by what they are."""
    home = layout.cells[str(row.home)].discretization
    cells = [layout.cells[name] for name in layout.cells_of[row.name]]
    own = [cell for cell in cells if cell.kind != "limit"]
    names = {_content(axes_between(home, cell)): cell.name for cell in own}
    for measure, cell in product(result.MEASURES, own):
        axes = axes_between(home, cell)
        if cell.integrator == TRUTH or len(axes) < 2 or (row.name, cell.name) in layout.broken:
            continue
        lost = partial(_lost, matrix, row, measure)
        total, costs = lost(cell.name), []
        for axis, changes in axes.items():
            alone = names.get(_content({axis: changes}))
            without = names.get(_content({k: x for k, x in axes.items() if k != axis}))
            costs.append(
                result.AxisCost(
                    axis=axis,
                    changes=changes,
                    alone=alone,
                    lost_alone=lost(alone),
                    without=without,
                    lost_without=lost(without),
                )
            )
        if total is not None and any(one.alone or one.without for one in costs):
            yield result.Separation(
                row=row.name, cell=cell.name, measure=measure, lost=total, axes=tuple(costs)
            )


def _lost(
    matrix: Matrix, row: result.Row, measure: result.Measure, cell: str | None
) -> stats.Estimate | None:
    """What a row loses against home; None without a cell, or where a return is not finite."""
    if cell is None:
        return None
    own, there = (matrix.means(row.name, name, measure) for name in (str(row.home), cell))
    if measure == "success":
        return stats.paired_difference(own, there).interval
    drop = own - there
    if not np.isfinite(drop).all():
        return None
    return stats.mean_interval(drop) or stats.Estimate(float(drop.mean()))


def _content(axes: Mapping[str, Mapping[str, Any]]) -> str:
    """Differences from home as text that compares."""
    return changes_name({name: x for own in axes.values() for name, x in sorted(own.items())})


WINDOW = 100
"""Finished training episodes over which success is averaged."""

RATE = 0.9
"""Share of them that must succeed, with exploration, on what the policy is trained on."""


def decisions_to_success(lengths: Array, successes: Array) -> float:
    """Decisions in the episodes up to the first where :data:`WINDOW` succeed often enough.

    Args:
        lengths: decisions of each episode, in the order in which they ended, shape (episodes,).
        successes: whether each succeeded, the same shape.

    Returns:
        A whole number; infinity if it never happens.
    """
    if len(lengths) < WINDOW:
        return math.inf
    succeeded = np.convolve(np.asarray(successes, dtype=np.int64), np.ones(WINDOW, int), "valid")
    reached = np.flatnonzero(succeeded >= RATE * WINDOW)
    return float(np.sum(lengths[: reached[0] + WINDOW])) if reached.size else math.inf


def training_costs(
    store: EvidenceStore, policies: Mapping[str, Sequence[str]]
) -> dict[str, result.TrainingCost]:
    """Cost of every row, from the records of its training episodes.

    Args:
        store: the panel's evidence.
        policies: policy ids by row.

    Returns:
        By row.
    """
    table = store.query(
        "SELECT policy_id, length, success FROM records WHERE phase = 'training' "
        "ORDER BY policy_id, episode_index"
    ).to_pydict()
    names = np.array(table["policy_id"], dtype=object)
    lengths, successes = (np.array(table[name]) for name in ("length", "success"))
    costs = {}
    for row, ids in policies.items():
        chosen = [names == policy for policy in ids]
        by_seed = [decisions_to_success(lengths[own], successes[own]) for own in chosen]
        costs[row] = result.TrainingCost(
            window=WINDOW,
            rate=RATE,
            by_seed=tuple(value if math.isfinite(value) else None for value in by_seed),
            reached=int(np.isfinite(by_seed).sum()),
            median=stats.median_interval(by_seed),
        )
    return costs
