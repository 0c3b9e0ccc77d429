"""What `panel` and `evaluate` print: the plan, the answer, verdicts and seeds wanted."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Final, TextIO

from integ_gym.eval.panel.conclusions import next_step
from integ_gym.eval.panel.costs import fixed_cost, policy_costs, total_cost
from integ_gym.eval.panel.elsewhere import all_cells, interpreters_of
from integ_gym.eval.panel.plan import family_power
from integ_gym.eval.panel.result import FILE_NAME, Look, Panel, read_panel
from integ_gym.eval.panel.spec import PanelSpec
from integ_gym.eval.power import Verdict
from integ_gym.eval.report.forests import ordered_verdicts
from integ_gym.eval.statistics import Estimate
from integ_gym.eval.verdict import MIN_SEEDS
from integ_gym.support.processes import cores
from integ_gym.support.terminal import (
    NONE,
    fixed,
    plural,
    print_columns,
    print_command,
    print_wrapped,
    seconds,
)


def print_headline(panel: Panel) -> None:
    """Print the first line of the answer."""
    print_wrapped(panel.headline, hanging="")


def print_details(panel: Panel) -> None:
    """Print the lines of the answer that stand below the first."""
    for line in panel.answer.splitlines()[1:]:
        print_wrapped(f"- {line}")


def print_next(panel: Panel) -> None:
    """Print what to do next, the command in lines of its own, so that it can be copied."""
    if (step := next_step(panel)) is not None:
        print(f"Next: {step.purpose.lower()}")
        print_command(step.command)


COUNTS = (10, 1_000, 100_000)
"""Numbers of policies whose cost is shown beside the panel's own."""


def print_plan(spec: PanelSpec, workers: int | None, trains: bool = True) -> None:
    """Print what a panel costs in core time and storage, and the same panel with more policies.

    Args:
        spec: the panel.
        workers: processes that share the work; by default one per core of this machine.
        trains: whether it does; False where another run's policies are judged.
    """
    count = workers or cores()
    each, fixed = policy_costs(spec), fixed_cost(spec, count)
    if not trains:
        fixed, *each = (cost._replace(train_seconds=0.0) for cost in (fixed, *each))
    mean = total_cost(each).times(1.0 / len(each)) if each else total_cost([])
    rows = []
    for policies in sorted({len(each), *(COUNTS if each else ())}):
        cost = total_cost([fixed, mean.times(policies)])
        rows.append(
            (
                f"{policies:,}" + (" (this panel)" if policies == len(each) else ""),
                _hours(cost.train_seconds),
                _hours(cost.evaluate_seconds),
                _hours(cost.seconds),
                _bytes(cost.storage),
                seconds(cost.seconds / count),
            )
        )
    print_wrapped(
        f"Panel {spec.name}: {plural(len(each), 'policy', 'policies')} and "
        f"{plural(len(spec.baselines), 'baseline')} in {_cells(spec)}. What it costs, from figures "
        "that were measured on one kind of machine; yours may take a third or twice as long:",
    )
    print_columns(
        (
            "policies", "training, core h", "evaluation, core h", "together", "storage",
            f"on {plural(count, 'worker')}",
        ),
        rows,
        right=(False, True, True, True, True, True),
    )  # fmt: skip
    _print_interpreters(spec)


def _print_interpreters(spec: PanelSpec) -> None:
    """Print which cells have other package versions, and the interpreters that these need."""
    cells = [cell for cell in all_cells(spec) if cell.packages]
    if not cells:
        return
    found = interpreters_of(spec)
    words = {False: "to be made with uv", True: "there"}
    needed = [f"{' '.join(packages)} ({words[there]})" for packages, there in found.items()]
    print_wrapped(
        f"{plural(len(cells), 'cell')} of these have other package versions, in "
        f"{plural(len(found), 'interpreter')} of their own: {', '.join(needed) or 'none'}."
    )


def _cells(spec: PanelSpec) -> str:
    """How many cells there are, and of what kinds."""
    kinds = {cell.name: cell.kind for home in (*spec.train, None) for cell in spec.cells_of(home)}
    counts: Counter[str] = Counter(kinds.values())
    words = {"grid": "of the grid", "reference": "of the truth", "varied": "varied"}
    words |= {"ladder": "in which the control period follows dt", "limit": "of the limit"}
    parts = [f"{counts[kind]} {what}" for kind, what in words.items() if counts[kind]]
    return f"{plural(len(kinds), 'cell')} ({', '.join(parts)})"


def _hours(core_seconds: float) -> str:
    return f"{core_seconds / 3600.0:{'.3g' if core_seconds < 3.6e6 else ',.0f'}}"


def _bytes(size: float) -> str:
    names = ("B", "kB", "MB", "GB", "TB", "PB")
    place = 0
    while size >= 1000.0 and place < len(names) - 1:
        size, place = size / 1000.0, place + 1
    return f"{size:.3g} {names[place]}"


def print_power(spec: PanelSpec, out: Path | None) -> None:
    """Print what the seeds of a specification can show; then what those of a finished panel lack.

    Args:
        spec: the panel.
        out: its directory; None without one.
    """
    finished = read_panel(out / FILE_NAME) if out and (out / FILE_NAME).exists() else None
    before = [] if finished is None else _earlier_looks(spec, finished)
    if not spec.family:
        print_wrapped(f"Panel {spec.name} declares no transfers, so there is nothing to decide.")
        return
    seeds, natives, power, fewest = family_power(spec, before)
    print_wrapped(
        f"Panel {spec.name}: {len(spec.family)} declared transfers, {seeds} training seeds "
        f"with {spec.episodes} starts each, {natives} seeds of natives at least. Chance of "
        "each verdict by true overfitting, lowest and highest of three simulated worlds (seeds "
        "that are all or nothing, that vary smoothly, a mixture):",
    )
    print_columns(
        ("overfitting", "transfers", "fails"),
        [(f"{one.overfitting:g}", _range(one.transfers), _range(one.fails)) for one in power],
        right=(True, True, True),
    )
    print_wrapped(
        f"`transfers` takes {fewest} seeds or more: with fewer it cannot be shown, even "
        "where every episode succeeds."
        if seeds < fewest
        else f"`transfers` can be shown: it takes {fewest} seeds where all episodes succeed.",
    )
    if 0 < natives < MIN_SEEDS:
        print_wrapped(
            f"Where natives have fewer than {MIN_SEEDS} seeds there is no verdict, however many "
            "seeds the row has: raise `exploratory_seeds`.",
        )
    if spec.looks:
        print_wrapped(
            f"Looks are planned at {' and '.join(map(str, spec.looks))} seeds and share the level "
            "of 0.05 equally; at another number of seeds there is no verdict.",
        )
    if before:
        looks = " and ".join(str(look.seeds) for look in before)
        print_wrapped(
            f"Verdicts were seen with {looks} seeds before. Looks share the level of 0.05, which "
            "these numbers take into account.",
        )
    if finished is not None:
        _print_wanted(finished)


def _earlier_looks(spec: PanelSpec, panel: Panel) -> list[Look]:
    """Looks at other seeds or episodes than these, or in another run."""
    now = (len(spec.seeds), spec.episodes)
    return [look for look in panel.looks if look.adopted or (look.seeds, look.episodes) != now]


def _print_wanted(panel: Panel) -> None:
    open_ones = [one for one in panel.verdicts if one.verdict == "inconclusive"]
    for one in open_ones:
        more = (
            f"about {one.seeds_wanted} seeds would decide it: --seeds {one.seeds_wanted}"
            if one.seeds_wanted
            else "eight times as many seeds would not decide it: its overfitting lies between the "
            "margins, or near one of them"
        )
        name = f"{panel.label(one.row)} → {panel.label(one.cell)}"
        print_wrapped(f"{name} is inconclusive with {panel.row(one.row).seeds} seeds; {more}.")
    if not open_ones:
        print_wrapped("No verdict of the finished panel wants for seeds.")


def _range(chances: tuple[float, float]) -> str:
    low, high = chances
    return f"{low:.2f}" if high - low < 0.005 else f"{low:.2f} to {high:.2f}"


TONES: Final = {
    "fails": "red",
    "transfers": "green",
    "inconclusive": "yellow",
    "contract_error": "dim",
    "not_learned": "dim",
    "unachievable": "dim",
    "too_slow": "dim",
    "undecided": "dim",
}
"""Verdict to its style of rich."""

_NAMES: Final = (
    "verdict", "trained on → judged on", "success", "loss", "of it overfitting", "interval"
)  # fmt: skip


def print_verdicts(panel: Panel, file: TextIO) -> None:
    """Print the declared family, failing transfers first, in colour where the terminal has it."""
    rows = [_row(panel, judged) for judged in ordered_verdicts(panel)]
    right = (False, False, True, True, True, True)
    print_columns(_NAMES, rows, file, right, colours=TONES)


def _row(panel: Panel, judged: Verdict) -> tuple[str, ...]:
    there, home = panel.entry(judged.row, judged.cell), panel.row(judged.row).home_success
    success = f"{_rate(home)} → {_rate(there.success if there else None)}"
    low, high = judged.overfitting.low, judged.overfitting.high
    return (
        judged.verdict,
        f"{panel.label(judged.row)} → {panel.label(judged.cell)}",
        success,
        fixed(judged.total.estimate),
        fixed(judged.overfitting.estimate),
        f"{fixed(low)} to {fixed(high)}" if judged.overfitting.bounded else NONE,
    )


def _rate(estimate: Estimate | None) -> str:
    return fixed(None if estimate is None else estimate.estimate)
