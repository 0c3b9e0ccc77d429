"""What casts doubt on the evaluation of a policy, each in a sentence with its remedy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from integ_gym.envs.foreign import SURVIVAL
from integ_gym.evidence.store import EvidenceStore, sql_literal
from integ_gym.support.terminal import percent
from integ_gym.train.policy_files.reading import STATE_DICT_ENDINGS
from integ_gym.train.policy_files.sidecar import how_to_state

from ..statistics import Estimate
from ..verdict import ALPHA, FAIL_MARGIN, p_text
from .findings import paired_episodes
from .matrix import Matrix, PanelLayout, compares_success, home_cell, reward_doubts
from .policies import Existing
from .spec import PanelSpec

FEWEST, ENOUGH = 6, 20
"""Paired episodes below which not even a sign test can show anything at 5 %, and those that do."""


def doubts_of(
    existing: Existing,
    spec: PanelSpec,
    layout: PanelLayout,
    matrix: Matrix,
    records: EvidenceStore,
) -> tuple[str, ...]:
    """All doubts, the gravest first."""
    return (
        *_doubt_scaling(existing),
        *([*_doubt_arguments(existing)] or _doubt_bounds(existing)),
        *_not_finite(existing, spec, records),
        *_doubt_divergence(existing, records),
        *_homeless(existing, spec.env_id),
        *_no_better(existing, spec, layout, matrix),
        *_cannot_fail(spec, records),
        *_start_alike(existing, spec, records),
        *reward_doubts(spec.env_id, records),
    )


def _doubt_scaling(existing: Existing) -> Iterator[str]:
    """Doubt where the observations that it learned from were of another scale."""
    if not existing.unscaled:
        return
    if any(Path(name).suffix in STATE_DICT_ENDINGS for name in existing.files):
        yield (
            f"{existing.policy.policy_id} has the actor of CleanRL's ppo_continuous_action, which "
            "learns from normalized observations and saves no statistics. It was judged without "
            "them, so it may do better with them; write its side-car again with "
            'obs_stats={"mean": …, "var": …}, or with obs_stats=False if it saw observations '
            "unchanged"
        )
        return
    remedy = "pass --obs-stats vecnormalize.pkl, also if it has norm_obs=False"
    if not existing.files:
        remedy = "load it with env=VecNormalize.load(path, venv)"
    yield (
        f"{existing.policy.policy_id} was trained inside VecNormalize, which scales observations. "
        f"It was judged without its statistics, so it may do better with them; {remedy}"
    )


def _doubt_arguments(existing: Existing) -> Iterator[str]:
    """Doubt where the environment is not that of the training, as far as that is known."""
    known = existing.provenance
    for name, value in known.overridden.items():
        yield (
            f"{existing.policy.policy_id} was trained with {name}={value} ({known.origin}) and was "
            f"judged with {name}={known.environment[name]}; leave out --env-arg {name}, unless "
            "another environment is meant"
        )


def _doubt_bounds(existing: Existing) -> Iterator[str]:
    """Doubt where the policy's actions have other bounds than the environment's."""
    own, space = getattr(existing.policy, "bounds", None), existing.action_space
    if own is None or not isinstance(space, spaces.Box):
        return
    taken = (space.low.ravel(), space.high.ravel())
    if not np.allclose(own, taken, rtol=1e-5, atol=0.0):
        yield (
            f"{existing.policy.policy_id} gives actions within {_within(*own)}, and the "
            f"environment takes {_within(*taken)}: was it trained with another limit? give the "
            "arguments of its training's environment with --env-arg"
        )


def _within(low: NDArray[Any], high: NDArray[Any]) -> str:
    """Bounds in a few words: `±2`, `0 to 1`, or one after another."""
    bounds = [f"±{b:g}" if a == -b else f"{a:g} to {b:g}" for a, b in zip(low, high, strict=True)]
    return ", ".join(bounds) if len(set(bounds)) > 1 else bounds[0]


def _not_finite(existing: Existing, spec: PanelSpec, records: EvidenceStore) -> Iterator[str]:
    """Doubt where the fallback acted in place of the policy, and not before its first command."""
    name, timing = existing.policy.policy_id, spec.nominal.timing
    if timing.hold:  # the fallback acts for as long as no command happens to arrive
        return
    late = -(-(timing.latency + timing.jitter) // timing.substeps)
    counted = records.query(
        f"SELECT sum(greatest(fallback_count - {late}, 0)) / sum(length) AS share FROM records "
        "WHERE phase = 'evaluation' AND perturbation IS NULL "
        f"AND policy_id = {sql_literal(name)}"
    )
    share = counted.to_pylist()[0]["share"]
    if share:
        amount = "less than 1 %" if share < 0.005 else percent(share)
        yield (
            f"in {amount} of control periods the fallback acted, because {name} gave no finite "
            "action. So results are not of the policy alone; find the observations at which this "
            "happens, and mend the policy"
        )


def _doubt_divergence(existing: Existing, records: EvidenceStore) -> Iterator[str]:
    """Doubt where no episode outlives its first decision, which no policy can be blamed for."""
    found = records.query(
        "SELECT cell FROM records WHERE phase = 'evaluation' AND length > 0 "
        f"AND policy_id = {sql_literal(existing.policy.policy_id)} GROUP BY cell "
        "HAVING bool_and(length = 1 AND solver_status = 'diverged') ORDER BY cell"
    )
    for row in found.to_pylist():
        yield (
            f"every episode diverges at its first decision in {row['cell']}, so the loss there "
            "may not be the policy's: the simulation may not work with these settings; leave that "
            "cell out, or give it a shorter step"
        )


def _homeless(existing: Existing, env_id: str) -> Iterator[str]:
    """What is not known where the home is not."""
    if existing.home is None:
        yield (
            f"the home of {existing.policy.policy_id} is unknown, so nothing is compared with "
            f"it and no failure is attributed to the discretization; {how_to_state(env_id)}"
        )


def _no_better(
    existing: Existing, spec: PanelSpec, layout: PanelLayout, matrix: Matrix
) -> Iterator[str]:
    """Doubt where the policy is no better than random at home, or anywhere without a home.

    Where it does far better elsewhere, the doubt is about its home.
    """
    home, elsewhere = home_cell(spec, existing.home), _far_better(existing, spec, layout, matrix)
    row = existing.policy.policy_id
    cells = [cell.name for cell in spec.columns()] if home is None else [home]
    leads = {cell: _lead(matrix, row, cell) for cell in cells}
    if any(lead > 2.0 * error for lead, error in leads.values()):
        yield from [f"{row} {elsewhere}"] if elsewhere else []
        return
    best = max(cells, key=lambda cell: leads[cell][0])
    own, chance = (matrix.values(name, best, "return")[0] for name in (row, "random"))
    compared = f"{own.mean():.1f} over {len(own)} episodes"
    few = f"{len(own)} episodes are too few to show anything, give --episodes {ENOUGH} or more; "
    few = few if len(own) < FEWEST else ""
    if home is None:
        yield (
            f"on no discretization is the policy shown to be better than random: it comes nearest "
            f"on {best}, with a return of {compared} where random's is {chance.mean():.1f}; "
            f"{few}{_remedy(existing)}"
        )
        return
    better = "no better than" if leads[best][0] <= 0 else "not shown to be better than"
    why = f"it {elsewhere}" if elsewhere else _remedy(existing)
    yield (
        f"on its home discretization ({home}) the policy's return {compared} is {better} "
        f"random's {chance.mean():.1f}; {few}{why}"
    )


def _far_better(
    existing: Existing, spec: PanelSpec, layout: PanelLayout, matrix: Matrix
) -> str | None:
    """That the policy does far better on a discretization than at home, in a clause; or None.

    Far is a success that is shown to be higher by more than verdicts let pass; of returns, a lead
    over random that is shown and more than twice that at home.
    """
    row, home = existing.policy.policy_id, home_cell(spec, existing.home)
    if home is None:
        return None
    success = compares_success(spec, matrix, row)
    kind, digits = ("success", 2) if success else ("return", 1)
    columns = {cell.name for cell in spec.columns()}
    found = []
    for one in paired_episodes(layout, matrix):
        lost, p = one.difference(kind) or (Estimate(0.0), 1.0)
        if one.cell in columns and p < ALPHA and lost.estimate < 0.0:
            lead, error = _lead(matrix, row, one.cell)
            leads = lead > 2.0 * error and lead > 2.0 * _lead(matrix, row, home)[0]
            if max(lost.ends) < -FAIL_MARGIN if success else leads:
                found.append((lost.estimate, one.cell, p))
    if not found:
        return None
    _, cell, p = min(found)
    there, here = (matrix.values(row, name, kind)[0].mean() for name in (cell, home))
    stated = existing.provenance.origin.startswith("stated")
    return (
        f"does far better on {cell} than at its stated home ({home}), with a mean {kind} of "
        f"{there:.{digits}f} where that gives {here:.{digits}f} (adjusted {p_text(p)}): is "
        f"{'--home' if stated else 'the side-car'} right?"
    )


def _lead(matrix: Matrix, row: str, cell: str) -> tuple[float, float]:
    """By how much the policy's mean return exceeds random's, and the standard error of that."""
    own, chance = (matrix.values(name, cell, "return")[0] for name in (row, "random"))
    difference = own - chance
    error = float(difference.std(ddof=1)) / math.sqrt(len(difference)) if len(own) > 1 else 0.0
    return float(difference.mean()), error


def _remedy(existing: Existing) -> str:
    if existing.unscaled:
        return "the missing statistics would explain it"
    if not existing.files:
        return "does it take this environment's observations, and give its actions?"
    if getattr(existing.policy, "statistics", None) is not None:
        return "was it trained for long enough?"
    long = "" if existing.seed is None else "was it trained for long enough? "
    return f"{long}trained with VecNormalize? pass --obs-stats vecnormalize.pkl"


def _cannot_fail(spec: PanelSpec, records: EvidenceStore) -> Iterator[str]:
    """Doubt where success is survival, and everybody survives."""
    success = spec.testbed.success
    if success.parameter is None or success.goal != SURVIVAL:
        return
    ended = "SELECT record_id FROM records WHERE phase = 'evaluation' AND terminated LIMIT 1"
    if not records.query(ended).num_rows:
        solved, flag = success.suggested, f"--{success.parameter.replace('_', '-')} R"
        suggestion = "" if solved is None else f" (Gymnasium calls the task solved at {solved:g})"
        yield (
            "no episode of any row ends before its time limit, so success, which is survival, "
            f"shows nothing here: compare returns, or give {flag}{suggestion}"
        )


def _start_alike(existing: Existing, spec: PanelSpec, records: EvidenceStore) -> Iterator[str]:
    """Doubt where all episodes begin with the same observation."""
    columns = records.query("DESCRIBE records").column("column_name").to_pylist()
    first = [f'"{name}"[1]' for name in columns if name.startswith("sensed_")]
    if not first:
        return
    cell = home_cell(spec, existing.home) or spec.columns()[0].name
    found = records.query(
        f"SELECT count(*) AS episodes, count(DISTINCT ({', '.join(first)})) AS starts FROM records "
        "WHERE phase = 'evaluation' AND perturbation IS NULL "
        f"AND policy_id = {sql_literal(existing.policy.policy_id)} AND cell = {sql_literal(cell)}"
    )
    ((episodes, starts),) = (row.values() for row in found.to_pylist())
    if starts == 1 < episodes:
        yield (
            f"all {episodes} episodes begin with the same observation, so they may be one episode "
            "again and again, and intervals say nothing of other starts; draw starts at random, a "
            "robot's by its testbed's `start` or `commands`"
        )
