"""Mixtures: discretizations of one environment, one of which every episode draws at its start."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import accumulate
from typing import Any

from integ_gym.support.parameters import positive, unknown_name

from .discretization import DISCRETIZATION
from .settings import Setup

WEIGHT = "weight"
"""Key of a member's weight: its share is its weight over the sum of all; 1 where it is left out."""


@dataclass(frozen=True)
class Mixture:
    """The discretizations of an environment; an environment without a mixture has one.

    Attributes:
        setups: one per member; they differ in engine, integrator and ``dt`` alone.
        shares: of each member, adding up to 1.
    """

    setups: tuple[Setup, ...]
    shares: tuple[Fraction, ...] = (Fraction(1),)

    def limited(self, max_episode_steps: int | None) -> Mixture:
        """The same with episodes of at most so many decisions; see :meth:`Setup.limited`."""
        return replace(self, setups=tuple(s.limited(max_episode_steps) for s in self.setups))

    def member(self, number: float) -> int:
        """The member that a number drawn from [0, 1) stands for."""
        *bounds, _ = accumulate(self.shares)
        return bisect_right(bounds, number)


def make_mixture(
    make_setup: Callable[[Mapping[str, Any]], Setup],
    arguments: Mapping[str, Any],
    members: Any,
) -> Mixture:
    """Parse the ``mixture`` argument of an environment.

    Args:
        make_setup: gives the setup of constructor arguments.
        arguments: the other constructor arguments.
        members: dicts of ``integrator``, ``dt``, … and, optionally, ``weight``; None: no mixture.

    Raises:
        TypeError, ValueError: for what is no list of such dicts, for impossible values, and for
            members of several control periods.
    """
    if members is None:
        return Mixture((make_setup(arguments),))
    checked = _checked_members(members)
    for name in DISCRETIZATION:
        if name in arguments and all(name in member for member in checked):
            raise ValueError(
                f"`{name}`={arguments[name]!r} acts nowhere: each member of `mixture` has its own; "
                "leave one of them out"
            )
    setups = tuple(
        make_setup({**arguments, **{k: x for k, x in member.items() if k != WEIGHT}})
        for member in checked
    )
    periods = sorted({setup.timing.control_period for setup in setups})
    if len(periods) > 1:
        raise ValueError(
            f"all discretizations of a mixture must have one control period, got {periods} s; "
            "give `control_period`"
        )
    weights = [Fraction(str(member.get(WEIGHT, 1))) for member in checked]
    return Mixture(setups, tuple(weight / sum(weights) for weight in weights))


def _checked_members(members: Any) -> Sequence[Mapping[str, Any]]:
    """Dicts with nothing but known keys, and possible weights."""
    if isinstance(members, str | Mapping) or not isinstance(members, Sequence):
        raise ValueError(f"`mixture` must be a list of discretizations, got {members!r}")
    if not members:
        raise ValueError("`mixture` must list at least one discretization, got none")
    for member in members:
        if not isinstance(member, Mapping):
            raise ValueError(
                f'every member of `mixture` must be like {{"integrator": "rk4", "dt": 0.01}}, got '
                f"{member!r}"
            )
        for name in member:
            if name not in (*DISCRETIZATION, WEIGHT):
                raise ValueError(unknown_name("key in `mixture`", name, (*DISCRETIZATION, WEIGHT)))
        wrong = positive(member.get(WEIGHT, 1.0))
        if wrong:
            raise ValueError(f"`{WEIGHT}` in `mixture` {wrong}, got {member[WEIGHT]!r}")
    return members
