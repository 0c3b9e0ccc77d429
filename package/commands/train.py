"""``integ-gym train``: train one policy with PPO, with either trainer."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from integ_gym.eval import doubt
from integ_gym.support import say
from integ_gym.train import TrainingConfig, training_command
from integ_gym.train import training_parser as parser

__all__ = ["main", "parser"]


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    return training_command(argv, on_config=_warn)


def _warn(config: TrainingConfig) -> None:
    found = doubt(config.env_id, config.env_arguments)
    if found is not None:
        say(f"integ-gym train: {found}", sys.stderr)
