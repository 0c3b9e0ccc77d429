"""Claims about a result, such as `loss > 0.1`, that a pipeline can fail on."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import NamedTuple

from integ_gym.support.errors import InputError
from integ_gym.support.parameters import unknown_name
from integ_gym.support.terminal import compact

from ..statistics import Estimate
from .cells import changes_name
from .result import Panel

_FORM = re.compile(r"\s*(loss|success|return)\s*([<>])\s*([-+.\deE]+)\s*(?:in\s+(.+?)\s*)?")


class Claim(NamedTuple):
    """That a number is beyond a bound.

    Attributes:
        measure: `loss` of success against home (where that is unknown, the truth or the limit);
            `success`; or `return`, the mean.
        above: whether the number is claimed to be above the bound, else below.
        bound: the bound.
        cell: name of the cell; None: the one in which it is most so, of the discretizations and of
            the variations that were asked for.
    """

    measure: str
    above: bool
    bound: float
    cell: str | None

    def check_cell(self, known: Collection[str]) -> None:
        """Refuse a cell that is none of some.

        Raises:
            ValueError: naming them.
        """
        if self.cell is not None and self.cell not in known:
            raise InputError(unknown_name("cell in --fail-if", self.cell, known))

    def find_support(self, panel: Panel) -> str | None:
        """What shows the claim about the policy that was given, in a sentence; None: nothing.

        It is shown where the whole 95 % interval is beyond the bound.

        Raises:
            ValueError: for a cell that there is not, or where nothing can be compared.
        """
        (row,) = (one.name for one in panel.rows if one.kind == "given")
        if self.measure == "loss":
            found = {one.cell: one.success for one in panel.paired if one.row == row}
        else:
            coarser = {
                cell.name for cell in panel.cells if cell.kind == "limit" and not cell.column
            }
            own = [e for e in panel.matrix if e.row == row and e.cell not in coarser]
            numbers = {e.cell: e.success if self.measure == "success" else e.returns for e in own}
            found = {cell: number for cell, number in numbers.items() if number is not None}
        if not found:
            raise InputError(f"there is no {self.measure} to fail on; state the home with --home")
        self.check_cell(found)
        standard = {
            one["name"]
            for one in panel.spec["variations"]
            if one["name"] != changes_name(one["changes"])
        }
        asked = [name for name in found if panel.cell(name).variation not in standard]
        found = {name: found[name] for name in ([self.cell] if self.cell else asked)}
        sign = 1.0 if self.above else -1.0
        cell = max(found, key=lambda name: sign * self._nearest(found[name]))
        if sign * (self._nearest(found[cell]) - self.bound) <= 0.0:
            return None
        low, high = map(compact, found[cell].ends)
        order = ">" if self.above else "<"
        return (
            f"{self.measure} {order} {self.bound:g} is shown in {panel.in_words(cell)}: "
            f"{compact(found[cell].estimate)} ({low} to {high})"
        )

    def _nearest(self, number: Estimate) -> float:
        """The end of an interval that is against the claim."""
        return number.ends[0 if self.above else 1]


def parse_claim(text: str) -> Claim:
    """Read a claim.

    >>> parse_claim("loss > 0.1 in rk4 dt=0.01")
    Claim(measure='loss', above=True, bound=0.1, cell='rk4 dt=0.01')

    Raises:
        ValueError: for text of another form.
    """
    found = _FORM.fullmatch(text)
    try:
        measure, order, bound, cell = found.groups() if found else (None, None, "", None)
        return Claim(str(measure), order == ">", float(str(bound)), cell)
    except ValueError:
        raise InputError(
            f'--fail-if must be like "loss > 0.1", "success < 0.9" or "return < 300 in CELL", got '
            f"{text!r}"
        ) from None
