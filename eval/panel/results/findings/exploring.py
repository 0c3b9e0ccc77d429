"""What a panel says that declared no family: exploratory, over every cell that can be judged."""

from __future__ import annotations

from collections.abc import Mapping

from ....verdict import EQUIVALENCE_MARGIN, FAIL_MARGIN, LEARNED
from ...model import Panel


def exploratory_answer(panel: Panel) -> str | None:
    """The largest loss by overfitting, in a sentence with numbers.

    None where policies were given, and where nothing but what was trained on can be judged.
    """
    if panel.given_alone:
        return None
    trained = [row for row in panel.rows if row.kind == "trained"]
    if not any(row.learned is not False for row in trained):
        known = {row.name: row.home_success.estimate for row in trained if row.home_success}
        return unlearned_answer("no policies have learned", known)
    found = panel.exploratory
    if not found:
        return None
    worst = found[0]
    home = panel.row(worst.row).home_success
    losses = [entry.overfitting.estimate for entry in found if entry.overfitting]
    lost = panel.exploratory_failures
    small = sum(loss <= EQUIVALENCE_MARGIN for loss in losses)
    at_home = f"{home.estimate:.2f} at home and " if home else ""
    otherwise = [
        f", {name} {part.estimate:z.2f}"
        for name, part in (("deadline", worst.deadline), ("difficulty", worst.difficulty))
        if part is not None
    ]
    return (
        f"Exploratory, since no family of transfers was declared: of {len(found)} transfers to "
        f"cells that can be solved in time {lost} {'loses' if lost == 1 else 'lose'} more than "
        f"{FAIL_MARGIN} of success by "
        f"overfitting and {small} at most {EQUIVALENCE_MARGIN}; the most is lost by overfitting to "
        f"{worst.row}: success is {at_home}{worst.success.estimate:.2f} on {worst.cell} "
        f"(overfitting {worst.overfitting}{''.join(otherwise)})."
    )


def unlearned_answer(who: str, home: Mapping[str, float]) -> str:
    """That nobody learned, and what to do about it.

    Args:
        who: nobody, in a clause.
        home: success at home by row.
    """
    best = max(home, key=lambda row: home[row])
    return (
        f"Not answered: {who}, which takes a success of {LEARNED} at home; those trained on {best} "
        f"come nearest, with {home[best]:.2f}. Train longer (`total_steps` in [training]), or set "
        "an easier task."
    )
