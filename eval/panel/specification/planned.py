"""A specification read back from a run's own plan, as `PanelSpec.to_json` wrote it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from integ_gym.envs.settings import WEIGHT, Discretization

from .cells.cell import (
    UNNAMED,
    DiscretizationMixture,
    Home,
    Perturbation,
)
from .cells.sweeps import Sweep
from .panel_spec import TRAINERS, PanelSpec
from .values import SpecError

_CODE = ("env_id", "environment", "train", "grid")
"""Parts whose texts may name code of somebody's own."""


class _Plan(msgspec.Struct, kw_only=True):
    """What `PanelSpec.to_json` writes."""

    name: str
    question: str
    env_id: str
    control_period: float
    environment: dict[str, Any]
    training: dict[str, Any]
    trainer: dict[str, str | None]
    train: list[dict[str, Any]]
    grid: list[Discretization]
    seeds: list[int]
    exploratory_seeds: int | None
    baselines: list[str]
    perturbations: list[Perturbation]
    sweeps: list[Sweep] = []
    family: list[tuple[str, str]]
    compare: list[tuple[str, str]]
    looks: list[int] = []
    ladder: bool
    episodes: int
    episode_parts: list[int] = []
    episode_seed: int
    trace_every: int


def planned_spec(plan: Mapping[str, Any]) -> PanelSpec:
    """The panel, or the evaluation, that a run's plan describes; no code that it names is loaded.

    Args:
        plan: the `specification` of a run's manifest.

    Raises:
        SpecError: if it is no plan of a panel, in one sentence.
    """
    try:
        told = msgspec.convert(dict(plan), _Plan)
        held = msgspec.structs.asdict(told)
        own: dict[str, Any] = {k: tuple(x) if isinstance(x, list) else x for k, x in held.items()}
        if told.trainer.get("name") not in TRAINERS:
            raise SpecError("its specification is damaged: it names no trainer that there is")
        own |= {"trainer": str(told.trainer["name"]), "train": tuple(map(_home, told.train))}
        if told.episode_parts and sum(told.episode_parts) != told.episodes:
            raise SpecError("its specification is damaged: `episode_parts` do not add up")
        return PanelSpec(**own)
    except (KeyError, msgspec.ValidationError) as error:
        raise SpecError(f"its specification is damaged: {error}") from None


def planned_home(plan: Mapping[str, Any]) -> Home | None:
    """What the policy of an evaluation was trained on, as its run was told; None: unknown.

    Raises:
        SpecError: if the plan does not say.
    """
    try:
        members = msgspec.convert(plan["home"]["discretizations"], list[Discretization] | None)
        if not members or len(members) == 1:
            return members[0] if members else None
        shares = msgspec.convert(plan["home"]["shares"], list[float])
        return DiscretizationMixture(UNNAMED, tuple(zip(members, shares, strict=True)))
    except (KeyError, TypeError, ValueError, msgspec.ValidationError) as error:
        raise SpecError(f"its `home` is damaged: {error}") from None


def names_code(plan: Mapping[str, Any]) -> bool:
    """Whether a plan names code of somebody's own, as ``"module:Name"``."""
    return any(":" in text for part in _CODE for text in texts_of(plan.get(part)))


def texts_of(value: Any) -> list[str]:
    """All texts in plain data, keys left out."""
    if isinstance(value, str):
        return [value]
    inner = value.values() if isinstance(value, Mapping) else value
    return [t for x in inner for t in texts_of(x)] if isinstance(inner, Iterable) else []


def _home(entry: dict[str, Any]) -> Home:
    if "mixture" not in entry:
        return msgspec.convert(entry, Discretization)
    weights = msgspec.convert([one.get(WEIGHT) for one in entry["members"]], list[float])
    members = msgspec.convert(entry["members"], list[Discretization])
    return DiscretizationMixture(str(entry["mixture"]), tuple(zip(members, weights, strict=True)))
