"""Checks of a whole specification: that its parts fit each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from integ_gym.envs.settings import DISCRETIZATION, Discretization
from integ_gym.train.runs import ALGORITHMS

from ...verdict import MIN_SEEDS
from .cells.cell import environments_of, file_name
from .panel_spec import ALGORITHM, STARTS_APART, TRAINERS, PanelSpec
from .values import SpecError, check_known, check_unique


def check_parts(spec: PanelSpec) -> None:
    """Check a specification.

    Raises:
        SpecError: for parts that contradict each other.
        TypeError, ValueError: for a cell that cannot be made.
    """
    check_known("trainer", spec.trainer, TRAINERS)
    _check_algorithm(spec)
    if spec.episodes < 1 or not spec.seeds or not spec.train:
        raise SpecError("`episodes`, `seeds` and `train` must each hold at least one")
    if spec.episodes > STARTS_APART:
        raise SpecError(f"`episodes` must be at most {STARTS_APART}, got {spec.episodes}")
    for name in ("exploratory_seeds", "trace_every"):
        value = getattr(spec, name)
        if value is not None and value < 1:
            raise SpecError(f"`{name}` must be 1 or above, got {value}")
    _check_looks(spec)
    named: dict[str, Sequence[Any]] = {
        "seeds": spec.seeds,
        "train": [home.name for home in spec.train],
        "baselines": spec.baselines,
        "perturbations": [p.name for p in spec.changes],
        "family": spec.family,
        "compare": spec.compare,
    }
    for label, values in named.items():
        check_unique(label, values)
    for perturbation in spec.changes:
        varied = set(perturbation.environment) & set(DISCRETIZATION)
        if varied:
            raise SpecError(
                f"perturbation {perturbation.name!r} changes `{sorted(varied)[0]}`, which is what "
                "cells vary; use `evaluate` for it"
            )
    every = [spec.cells_of(home) for home in (*spec.train, None)]
    for cells in every:
        check_unique("cells", [cell.name for cell in cells])
    for cell in {cell.name: cell for cells in every for cell in cells}.values():
        environments_of(spec.testbed, cell, 1).close()
    for trained in spec.trained_on():
        if trained not in spec.grid and trained != spec.reference:
            raise SpecError(
                f"every training discretization must also be evaluated, {trained.name!r} is not; "
                "add it to `evaluate`"
            )
    columns = {cell.name for cell in spec.columns()}
    _check_mixture_names(spec, columns)
    homes = {home.name: home for home in spec.train}
    for home_name, cell_name in spec.family:
        check_known("training discretization in `family`", home_name, homes)
        check_known("cell in `family`", cell_name, columns)
        if cell_name in {member.name for member in homes[home_name].shares}:
            raise SpecError(
                f"`family` compares {home_name!r} with its own home {cell_name!r}; name a cell "
                "that it was not trained in"
            )
    for pair in spec.compare:
        for name in pair:
            check_known("training discretization in `compare`", name, homes)
        _check_comparison(spec, pair)


def _check_looks(spec: PanelSpec) -> None:
    """Planned looks must be at ever more seeds, with each of which something is tested."""
    if (
        list(spec.looks) != sorted(set(spec.looks))
        or min(spec.looks, default=MIN_SEEDS) < MIN_SEEDS
    ):
        raise SpecError(
            f"`looks` must hold numbers of seeds from {MIN_SEEDS} on, each above the one before, "
            f"got {list(spec.looks)}; with `looks = [{len(spec.seeds)}]` all is spent on one look"
        )


def _check_algorithm(spec: PanelSpec) -> None:
    name = spec.training.get(ALGORITHM)
    if name is None:
        return
    check_known(f"`{ALGORITHM}` in `training`", str(name), ALGORITHMS)
    if spec.fleet and name != next(iter(ALGORITHMS)):
        raise SpecError(
            f"the fleet does not train by {spec.algorithm.config.algorithm}; take "
            '`trainer = "sb3"`, or --trainer sb3'
        )


def check_environment(environment: Mapping[str, Any]) -> None:
    """Refuse arguments of all cells that cells vary.

    Raises:
        SpecError: for such an argument, with where to give it.
    """
    varied = set(environment) & {*DISCRETIZATION, "mixture"}
    if varied:
        raise SpecError(
            f"`environment` gives `{sorted(varied)[0]}`, which is what cells vary; use "
            "`control_period`, `train` and `evaluate` for it"
        )


def _check_mixture_names(spec: PanelSpec, columns: set[str]) -> None:
    """A mixture's name must be no other row's, no cell's, and one of its own as a file's."""
    files = [file_name(name) for name in (*(home.name for home in spec.train), *spec.baselines)]
    for home in spec.train:
        if isinstance(home, Discretization):
            continue
        if home.name in columns or files.count(file_name(home.name)) > 1:
            raise SpecError(
                f"mixture {home.name!r} is named like another row or cell; give it another name"
            )


def _check_comparison(spec: PanelSpec, pair: tuple[str, str]) -> None:
    """A comparison is decided at a quarter of each home's step and on the reference.

    Of the steps that a mixture has of one integrator, the coarsest counts.
    """
    if pair[0] == pair[1]:
        raise SpecError(f"`compare` names {pair[0]!r} twice; name two training discretizations")
    if spec.reference is None:
        raise SpecError(
            f"`compare` is decided on the truth, and {spec.env_id} has none; leave it out"
        )
    homes = {d for home in spec.train if home.name in pair for d in home.shares}
    by_step = sorted(homes - {spec.reference}, key=lambda d: (d.dt, d.name))
    for own, home in {(d.engine, d.integrator): d for d in by_step}.items():
        finest = min(d.dt for d in spec.grid if (d.engine, d.integrator) == own)
        if finest * 4.0 > home.dt * (1.0 + 1e-9):
            raise SpecError(
                f"`compare` needs {home.integrator} evaluated at dt={home.dt / 4.0:g} or finer, a "
                f"quarter of {home.name}'s; add it to `evaluate`"
            )
