"""What the seeds of a panel can show, before anything runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..power import Power, fewest_seeds, verdict_chances
from ..verdict import ALPHA, Looks, Shares
from .result import Look
from .spec import PanelSpec


@dataclass(frozen=True)
class FamilyPower:
    """Power of a panel's declared transfers.

    Attributes:
        family: how many are declared.
        seeds: of the rows that they name.
        natives: seeds of the row with the fewest that was trained in a cell that they name.
        power: by true overfitting.
        fewest: seeds with which `transfers` can be shown where every episode succeeds.
    """

    family: int
    seeds: int
    natives: int
    power: tuple[Power, ...]
    fewest: int


def family_power(spec: PanelSpec, before: Sequence[Look] = ()) -> FamilyPower | None:
    """Power of a panel's declared transfers, simulated; None without any.

    Args:
        spec: the panel.
        before: earlier looks at its verdicts.
    """
    if not spec.family:
        return None
    seen = (
        Shares(look.level_exceeds / ALPHA, look.level_equivalent / ALPHA)
        if look.adopted
        else look.seeds
        for look in before
    )
    looks = Looks(tuple(seen), spec.looks)
    cells, rows = {cell for _, cell in spec.family}, {row for row, _ in spec.family}
    seeds = min(len(spec.seeds_of(home)) for home in spec.train if home.name in rows)
    natives = min((len(spec.seeds_of(h)) for h in spec.train if h.name in cells), default=0)
    family = len(spec.family)
    found = verdict_chances(seeds, natives, spec.episodes, family, looks)
    return FamilyPower(family, seeds, natives, found, fewest_seeds(family, looks))
