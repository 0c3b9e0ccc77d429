"""What a page needs to simulate in its reader's browser: policies, and steps of discretizations."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import ENVIRONMENTS, INTEGRATORS
from integ_gym.envs.settings import NATIVE, Setup
from integ_gym.envs.steps import Script, script_of
from integ_gym.train.policy import MlpPolicy
from integ_gym.train.policy_files.limits import PolicyFileError
from integ_gym.train.policy_files.reading import read_weights
from integ_gym.train.policy_files.sidecar import WEIGHTS_FILE

from ...panel.model.matrix import Cell, Policy
from ...panel.model.panel import Panel
from .choice import Lead

MOST_POLICIES: Final = 6
"""Policies whose weights a page carries."""

MOST_CELLS: Final = 24
"""Discretizations that a page simulates."""

ACTIVATIONS: Final = ("Tanh", "ReLU")
"""Of networks that the page's script evaluates."""

_MOST_WEIGHTS: Final = 20_000
_FARTHEST: Final = {"rad": 3.1415, "m": 1.0}
"""How far from zero a start may be chosen, by the coordinate's unit."""


@dataclass(frozen=True)
class Live:
    """What can be simulated.

    Attributes:
        policies: by row and place of the seed, in the order of the leads.
        scripts: steps by name of the cell, written from the one definition of the physics.
        periods: time between two decisions by name of the cell, s.
        coordinate: place of the coordinate whose start can be chosen.
        reach: the farthest start to either side of zero, in the coordinate's unit.
    """

    policies: Mapping[tuple[str, int], MlpPolicy]
    scripts: Mapping[str, Script]
    periods: Mapping[str, float]
    coordinate: int
    reach: float


def live_of(panel: Panel, leads: Iterable[Lead], directory: Path) -> Live | None:
    """What can be simulated of a panel in a directory; None if nothing can."""
    leads = list(leads)
    policies = dict(_policies(panel, leads, directory))
    return with_policies(panel, leads, policies)


def with_policies(
    panel: Panel, leads: Iterable[Lead], policies: Mapping[tuple[str, int], MlpPolicy]
) -> Live | None:
    """As :func:`live_of`, with these policies."""
    if not policies:
        return None
    scripts: dict[str, Script] = {}
    setup, periods = None, {}
    for cell in _cells(panel, leads):
        made = _setup(panel, cell)
        script = made and script_of(made)
        if made and script:
            scripts[cell.name], setup = script, made
            periods[cell.name] = cell.control_period
        if len(scripts) == MOST_CELLS:
            break
    if setup is None:
        return None
    units = setup.plant.coordinate_units
    coordinate = units.index("rad") if "rad" in units else 0
    return Live(policies, scripts, periods, coordinate, _reach(setup, coordinate))


def _policies(
    panel: Panel, leads: Iterable[Lead], directory: Path
) -> Iterator[tuple[tuple[str, int], MlpPolicy]]:
    """Policies of the leads that are simple networks, as long as there is room."""
    places = dict.fromkeys((lead.row, lead.seed) for lead in leads)
    found = 0
    for row, seed in places:
        policy = policy_read(panel.row(row).policies[seed], directory)
        if policy is not None and found < MOST_POLICIES:
            found += 1
            yield (row, seed), policy


def policy_read(told: Policy, directory: Path) -> MlpPolicy | None:
    """The network of a policy, if it is the one that the panel judged."""
    if not told.file:
        return None
    kept = directory / told.file
    statistics = next(kept.parent.glob("obs_stats.*"), None)
    for path in (kept.with_name(WEIGHTS_FILE), kept):
        with suppress(OSError, ValueError, PolicyFileError, ModuleNotFoundError):
            card = path.with_suffix(".json")
            beside = json.loads(card.read_text("utf-8")) if card.exists() else None
            policy = read_weights(path, beside, statistics)
            if policy.content_hash == told.hash:
                return policy if isinstance(policy, MlpPolicy) and _is_simple(policy) else None
    return None


def _is_simple(policy: MlpPolicy) -> bool:
    size = sum(weight.size for weight, _ in policy.layers)
    return policy.activation in ACTIVATIONS and size <= _MOST_WEIGHTS


def _cells(panel: Panel, leads: Iterable[Lead]) -> list[Cell]:
    """Native cells without a perturbation: those of the leads first, then from coarse to fine."""
    asked = dict.fromkeys(name for lead in leads for name in lead.cells)
    others = sorted(panel.columns, key=lambda cell: -cell.dt)
    names = dict.fromkeys([*asked, *(cell.name for cell in others)])
    known = INTEGRATORS.names()
    cells = [panel.cell(name) for name in names]
    return [
        cell
        for cell in cells
        if cell.engine == NATIVE and cell.integrator in known and cell.perturbation is None
    ]


def _setup(panel: Panel, cell: Cell) -> Setup | None:
    env_id = panel.spec.get("env_id")
    if env_id not in ENVIRONMENTS:
        return None
    chosen = {
        name: getattr(cell, name) for name in ("engine", "integrator", "dt", "control_period")
    }
    with suppress(TypeError, ValueError):
        return environment_setup(env_id, {**panel.spec.get("environment", {}), **chosen})
    return None


def _reach(setup: Setup, place: int) -> float:
    """How far a coordinate may be from zero, the others at rest there, without an end."""
    count = len(setup.plant.coordinates)
    farthest = _FARTHEST.get(setup.plant.coordinate_units[place], 1.0)

    def goes_on(distance: float) -> bool:
        q = tuple(distance if k == place else 0.0 for k in range(count))
        return not setup.task.terminated(SCALAR, q, (0.0,) * count)

    if goes_on(farthest):
        return farthest
    steps = 100
    return max((farthest * k / steps for k in range(steps) if goes_on(farthest * k / steps)),
               default=0.0)  # fmt: skip
