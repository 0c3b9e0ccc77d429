"""Whether policies do the same on engines that apply the same one-step map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.plants.interface import Plant
from integ_gym.envs.registries import ENGINES
from integ_gym.envs.settings import NATIVE, Discretization

from ...model.conclusions import EngineAgreement
from ...specification.cells.cell import Cell
from ...specification.cells.engines import is_engine, map_of
from ...specification.panel_spec import PanelSpec
from ..layout import PanelLayout
from ..matrix import Matrix

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
    wanted = map_of(own)
    ours = VARIANTS.get(wanted, wanted)
    if ours != wanted and not _same_steps(ours, wanted, plant, own.dt):
        return None
    if resisted and ENGINES.load(own.engine).holds_resistance and ours not in EVALUATED_ONCE:
        return None
    twin = Discretization(ours, own.dt, own.control_period)
    same = (
        name
        for name, other in cells.items()
        if other.discretization == twin and other.kind == cell.kind
    )
    return next(same, None)


def _same_steps(first: str, second: str, plant: Plant, dt: float) -> bool:
    cases = numerics.cases_of(plant, controlled=True)
    steps = [
        [numerics.mapped(name, plant, dt, 1, case) for case in cases] for name in (first, second)
    ]
    return max(map(numerics.largest_error, *steps)) < SAME


def agreements(layout: PanelLayout, matrix: Matrix, spec: PanelSpec) -> tuple[EngineAgreement, ...]:
    """Every grid cell on a foreign engine beside its native twin.

    Args:
        layout: cells and rows.
        matrix: episodes of every row in every cell.
        spec: of the panel, whose plant has stops or friction, or has not.
    """
    foreign = [
        cell
        for cell in layout.cells.values()
        if cell.kind == "grid" and cell.discretization.engine != NATIVE
    ]
    if not foreign or spec.reference is None:
        return ()
    nominal = spec.nominal
    twins = {
        cell.name: twin_of(cell, layout.cells, nominal.plant, nominal.system.steep)
        for cell in foreign
    }
    return tuple(_agreement(cell, twins[cell.name], layout, matrix) for cell in foreign)


def _agreement(
    cell: Cell, twin: str | None, layout: PanelLayout, matrix: Matrix
) -> EngineAgreement:
    rows = [row.name for row in layout.rows]
    here = [matrix.values(row, cell.name, "success") for row in rows]
    there = [] if twin is None else [matrix.values(row, twin, "success") for row in rows]
    pairs = list(zip(here, there, strict=False))
    return EngineAgreement(
        cell=cell.name,
        **cell.discretization.arguments(),
        map=map_of(cell.discretization),
        twin=twin,
        episodes=sum(values.size for values in here),
        success=_mean(here),
        twin_success=_mean(there) if there else None,
        differing=int(sum((a != b).sum() for a, b in pairs)) if pairs else None,
        largest=float(max(abs(a.mean() - b.mean()) for a, b in pairs)) if pairs else None,
    )


def _mean(values: Sequence[Any]) -> float:
    return float(np.concatenate([v.ravel() for v in values]).mean())
