"""``integ-gym panel --power``: what a panel's seeds can show, and what its verdicts want for."""

from __future__ import annotations

import sys
from pathlib import Path

from integ_gym.eval.panel.model.files import FILE_NAME, read_panel
from integ_gym.eval.panel.model.panel import Look, Panel
from integ_gym.eval.panel.power import family_power
from integ_gym.eval.panel.specification.panel_spec import PanelSpec
from integ_gym.support.terminal.text_table import print_aligned, say


def print_power(spec: PanelSpec, out: Path | None) -> None:
    """Print what the seeds of a specification can show; then what a finished panel's want for.

    Args:
        spec: the panel.
        out: its directory; None without one.
    """
    finished = read_panel(out / FILE_NAME) if out and (out / FILE_NAME).exists() else None
    before = [] if finished is None else _seen_before(spec, finished)
    told = family_power(spec, before)
    if told is None:
        say(f"Panel {spec.name} declares no transfers, so there is nothing to decide.", sys.stdout)
        return
    say(
        f"Panel {spec.name}: {told.family} declared transfers, {told.seeds} training seeds with "
        f"{spec.episodes} starts each, {told.natives} seeds of natives at least. Chance of each "
        "verdict by true overfitting, lowest and highest of three simulated worlds (seeds that are "
        "all or nothing, that vary smoothly, a mixture):",
        sys.stdout,
    )
    print_aligned(
        ("overfitting", "transfers", "fails"),
        [(f"{one.overfitting:g}", _range(one.transfers), _range(one.fails)) for one in told.power],
        sys.stdout,
        right=(True, True, True),
    )
    say(
        f"`transfers` takes {told.fewest} seeds or more: with fewer it cannot be shown, even where "
        "every episode succeeds."
        if told.seeds < told.fewest
        else f"`transfers` can be shown: it takes {told.fewest} seeds where all episodes succeed.",
        sys.stdout,
    )
    if spec.looks:
        say(
            f"Looks are planned at {' and '.join(map(str, spec.looks))} seeds and share the level "
            "of 0.05 equally; at another number of seeds there is no verdict.",
            sys.stdout,
        )
    if before:
        looks = " and ".join(str(look.seeds) for look in before)
        say(
            f"Verdicts were seen with {looks} seeds before. Looks share the level of 0.05, which "
            "these numbers take into account.",
            sys.stdout,
        )
    if finished is not None:
        _print_wanted(finished)


def _seen_before(spec: PanelSpec, panel: Panel) -> list[Look]:
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
        say(
            f"{one.name} is inconclusive with {panel.row(one.row).seeds} seeds; {more}.", sys.stdout
        )
    if not open_ones:
        say("No verdict of the finished panel wants for seeds.", sys.stdout)


def _range(chances: tuple[float, float]) -> str:
    low, high = chances
    return f"{low:.2f}" if high - low < 0.005 else f"{low:.2f} to {high:.2f}"
