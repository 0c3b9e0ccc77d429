"""What an integrator says of itself, and whether it can be examined at all."""

from __future__ import annotations

import numbers
from collections.abc import Callable
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.integrators.interface import LinearTheory
from integ_gym.envs.registries import INTEGRATORS

from .subject import Subject

_LANES = 2


def theory_of(integrator: str) -> LinearTheory | None:
    """What an integrator's class itself declares; None where it says nothing.

    None, too, of a user's own that cannot be loaded, where only its results are drawn.
    """
    try:
        owner = INTEGRATORS.load(integrator)
    except ValueError:
        return None
    theory: LinearTheory | None = vars(owner).get("theory")
    return theory


def check_integrator(name: str, subject: Subject) -> None:
    """Refuse an integrator whose attributes say nothing, or that cannot take a step.

    Args:
        name: a registered name or ``"module:Class"``.
        subject: the plant to take it on.

    Raises:
        ValueError: for an unknown integrator, and for one of the above.
    """
    said = numerics.declared(name)
    _require(name, "order", said.order, _whole, "a whole number above 0")
    for attribute in ("symplectic", "reversible"):
        _require(name, attribute, getattr(said, attribute), _boolean, "True or False")
    owner = INTEGRATORS.load(name)
    for attribute in ("solver_tolerance", "solver_cap"):
        _require(name, attribute, getattr(owner, attribute, None), _positive, "a number above 0")
    dt = subject.steps[-1]
    try:
        numerics.advance(name, subject.plant, subject.start, dt)
        numerics.advance_lanes(name, subject.plant, np.tile(subject.start, (_LANES, 1)), dt)
    except Exception as error:  # whatever a user's step does
        what = " ".join(str(error).split())
        raise ValueError(
            f"the integrator {name!r} cannot take a step on {subject.name}: "
            f"{type(error).__name__}: {what}; docs/how-to/adding.md says what an integrator must be"
        ) from error


def _require(
    name: str, attribute: str, value: Any, valid: Callable[[Any], bool], wanted: str
) -> None:
    if value is not None and not valid(value):
        raise ValueError(
            f"`{attribute}` of the integrator {name!r} must be {wanted}, got {value!r}; leave it "
            "out where nothing is promised"
        )


def _whole(value: Any) -> bool:
    return isinstance(value, numbers.Integral) and not _boolean(value) and int(value) > 0


def _positive(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not _boolean(value) and float(value) > 0.0


def _boolean(value: Any) -> bool:
    return isinstance(value, (bool, np.bool_))
