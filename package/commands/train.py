"""``integ-gym train``: train one policy with PPO, with either trainer."""

from __future__ import annotations

from integ_gym.train.command import training_command as main
from integ_gym.train.command import training_parser as parser

__all__ = ["main", "parser"]
