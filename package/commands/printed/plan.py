"""``integ-gym panel --plan``: what a panel costs, before anything runs."""

from __future__ import annotations

import sys
from dataclasses import replace

from integ_gym.eval.panel.running.costs.expected_cost import fixed_cost, policy_costs, total_cost
from integ_gym.eval.panel.specification.panel_spec import PanelSpec
from integ_gym.support.processes.workers import cores
from integ_gym.support.terminal.formatting import plural
from integ_gym.support.terminal.text_table import print_aligned, say

COUNTS = (10, 1_000, 100_000)
"""Policies whose cost is told beside the panel's own."""


def print_plan(spec: PanelSpec, workers: int | None, trains: bool = True) -> None:
    """Print what a panel costs in core time and storage, and the same panel with more policies.

    Args:
        spec: the panel.
        workers: processes that share the work; by default one per core of this machine.
        trains: whether it does; False where another run's policies are judged.
    """
    count = workers or cores()
    each, fixed = policy_costs(spec), fixed_cost(spec)
    if not trains:
        each = [replace(cost, train_seconds=0.0) for cost in each]
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
                _clock(cost.seconds / count),
            )
        )
    say(
        f"Panel {spec.name}: {plural(len(each), 'policy', 'policies')} and "
        f"{plural(len(spec.baselines), 'baseline')}. What it costs, from figures that were "
        "measured on one kind of machine; yours may take a third or twice as long:",
        sys.stdout,
    )
    print_aligned(
        (
            "policies", "training, core h", "evaluation, core h", "together", "storage",
            f"on {plural(count, 'worker')}",
        ),
        rows,
        sys.stdout,
        right=(False, True, True, True, True, True),
    )  # fmt: skip


def _hours(seconds: float) -> str:
    return f"{seconds / 3600.0:.3g}" if seconds < 3.6e6 else f"{seconds / 3600.0:,.0f}"


def _bytes(size: float) -> str:
    names = ("B", "kB", "MB", "GB", "TB", "PB")
    place = 0
    while size >= 1000.0 and place < len(names) - 1:
        size, place = size / 1000.0, place + 1
    return f"{size:.3g} {names[place]}"


def _clock(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    if seconds < 7200.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h" if seconds < 172800.0 else f"{seconds / 86400.0:.1f} days"
