"""Tasks: one module each, found by name."""

from integ_gym.support import Registry

TASKS = Registry(__name__, "task", "reward")
