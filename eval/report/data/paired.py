"""Given policies held against themselves, start by start: success and mean return."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

from integ_gym.support.terminal import compact, fixed, percent

from ...panel.model.conclusions import PairedEpisodes
from ...panel.model.panel import Panel
from ...panel.model.part import Estimate
from ...verdict.rules import ALPHA, EQUIVALENCE_MARGIN, p_text
from .axes import Axis, difference_axis, value_axis
from .forest import Block, Forest, Line, Mark, Tone

_Compared = tuple[PairedEpisodes, Estimate, float]
"""Of one cell: what is held against what, the difference and its adjusted p-value."""


def paired_success(panel: Panel) -> Forest | None:
    """What every given policy loses of its success in each cell; None without any."""
    found = [(one, one.success, one.p_success_adjusted) for one in panel.paired]
    told = partial(fixed, digits=2)
    return _forest(panel, "Success lost", found, difference_axis, told, EQUIVALENCE_MARGIN)


def paired_return(panel: Panel) -> Forest | None:
    """What every given policy loses of its mean return in each cell; None without any."""
    found = [
        (one, one.returns, one.p_return_adjusted)
        for one in panel.paired
        if one.returns is not None and one.p_return_adjusted is not None
    ]
    return _forest(panel, "Mean return lost", found, value_axis, partial(compact, digits=3))


def _forest(
    panel: Panel,
    title: str,
    found: list[_Compared],
    axis: Callable[[Iterable[Estimate]], Axis],
    told: Callable[..., str],
    margin: float | None = None,
) -> Forest | None:
    if not found:
        return None
    blocks: dict[tuple[str, bool], list[_Compared]] = {}
    for compared in found:
        key = (compared[0].row, panel.cell(compared[0].cell).perturbation is not None)
        blocks.setdefault(key, []).append(compared)
    levels = {value.level for _, value, _ in found if value.level is not None}
    level = f"{percent(levels.pop())}, " if len(levels) == 1 else ""
    equal = f"; green: practically equal (within ±{margin})" if margin else ""
    return Forest(
        title,
        f"positive is worse; intervals over starts, {level}not adjusted; p adjusted over the "
        f"cells; filled: below {ALPHA}{equal}",
        title.lower(),
        axis(value for _, value, _ in found),
        tuple(
            Block(
                _heading(block[0][0], perturbed),
                [_line(panel, title, told, margin, *compared) for compared in block],
            )
            for (_, perturbed), block in blocks.items()
        ),
    )


def _heading(one: PairedEpisodes, perturbed: bool) -> str:
    where = "at home" if one.against == "home" else "on the truth"
    what = "perturbations" if perturbed else "discretizations"
    return f"{one.row}, {one.episodes} starts: {what} against what it does {where}"


def _line(
    panel: Panel,
    title: str,
    told: Callable[..., str],
    margin: float | None,
    one: PairedEpisodes,
    value: Estimate,
    p: float,
) -> Line:
    low, high = value.ends
    interval = f"{told(low)} to {told(high)}, " if value.bounded else ""
    number, shown = told(value.estimate, sign=True), p < ALPHA
    equal = margin is not None and value.bounded and -margin <= low and high <= margin
    tone: Tone = "transfers" if equal else "accent" if shown else "soft"
    practically = ", practically equal" if equal else ""
    return Line(
        "",
        panel.called(one.cell),
        (one.row, one.cell),
        (Mark(value, tone, filled=shown),),
        number,
        f"{interval}{p_text(p)}",
        f"{one.row} on {one.cell}: {title.lower()} {number}, {interval}adjusted {p_text(p)}"
        f"{practically}",
    )
