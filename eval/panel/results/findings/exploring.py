"""What a panel says that declared no family: exploratory, over every cell that can be judged."""

from __future__ import annotations

from ....verdict import EQUIVALENCE_MARGIN, FAIL_MARGIN
from ...model import Panel


def exploratory_answer(panel: Panel) -> str | None:
    """The largest loss by overfitting, in a sentence with numbers.

    None where policies were given, and where nothing can be judged: nothing was learned, or no cell
    is known to be solvable in time.
    """
    found = panel.exploratory
    if panel.given_alone or not found:
        return None
    worst = found[0]
    home = panel.row(worst.row).home_success
    losses = [entry.overfitting.estimate for entry in found if entry.overfitting]
    lost = sum(loss > FAIL_MARGIN for loss in losses)
    small = sum(loss <= EQUIVALENCE_MARGIN for loss in losses)
    at_home = f"{home.estimate:.2f} at home and " if home else ""
    otherwise = [
        f", {name} {part.estimate:z.2f}"
        for name, part in (("deadline", worst.deadline), ("difficulty", worst.difficulty))
        if part is not None
    ]
    return (
        f"Exploratory, since no family of transfers was declared: of {len(found)} transfers to "
        f"cells that can be solved in time {lost} lose more than {FAIL_MARGIN} of success by "
        f"overfitting and {small} at most {EQUIVALENCE_MARGIN}; the most is lost by overfitting to "
        f"{worst.row}: success is {at_home}{worst.success.estimate:.2f} on {worst.cell} "
        f"(overfitting {worst.overfitting}{''.join(otherwise)})."
    )
