"""Doubt in an evaluation whose policy is no better than random at home."""

from __future__ import annotations

import math
from typing import Any

import numpy.typing as npt

from integ_gym.eval.cells import Cell
from integ_gym.eval.evaluation import conditions_of, outcomes_in
from integ_gym.eval.existing.plan import main_home
from integ_gym.eval.existing.policy import Existing
from integ_gym.eval.panel import nominal_setup
from integ_gym.eval.spec import PanelSpec
from integ_gym.train.baselines import make_baseline

Array = npt.NDArray[Any]


def doubts(existing: Existing, spec: PanelSpec) -> list[str]:
    """Doubt where the policy is no better than random on its own discretization."""
    home, conditions = Cell(main_home(existing.home), "grid"), conditions_of(spec)
    random = make_baseline("random", nominal_setup(spec))
    own, chance = outcomes_in(home, [existing.policy, random], conditions).returns
    return doubts_of(existing, home.name, own, chance)


def doubts_of(existing: Existing, home: str, own: Array, chance: Array) -> list[str]:
    """Doubt where a policy is no better than random.

    Args:
        existing: the policy.
        home: name of its home cell.
        own: its returns there, shape (episodes,).
        chance: those of the random policy from the same starts.
    """
    difference = own - chance
    error = float(difference.std(ddof=1)) / math.sqrt(len(difference)) if len(own) > 1 else 0.0
    if difference.mean() > 2.0 * error:
        return []
    better = "no better than" if difference.mean() <= 0 else "not shown to be better than"
    remedy = (
        "trained with VecNormalize? pass --obs-stats FILE.json"
        if existing.seed is None
        else "was it trained for long enough?"
    )
    return [
        f"on its home discretization ({home}) the policy's return {own.mean():.1f} over "
        f"{len(own)} episodes is {better} random's {chance.mean():.1f}; {remedy}"
    ]
