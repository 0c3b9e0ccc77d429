"""A panel's answer on the terminal: what was found, and what to do next."""

from __future__ import annotations

import sys

from integ_gym.eval.panel.answer import next_step
from integ_gym.eval.panel.model.panel import Panel
from integ_gym.support.terminal.text_table import say


def print_headline(panel: Panel) -> None:
    """Print the first line of the answer."""
    say(panel.said(panel.headline), sys.stdout, hanging="")


def print_details(panel: Panel) -> None:
    """Print the lines of the answer that stand below the first."""
    for line in panel.answer.splitlines()[1:]:
        say(f"- {panel.said(line)}", sys.stdout)


def print_next(panel: Panel) -> None:
    """Print what to do next, the command in a line of its own, so that it can be copied."""
    if (step := next_step(panel)) is not None:
        print(f"Next: {step.purpose.lower()}\n  {step.command}")
