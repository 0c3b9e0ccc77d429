"""Engines: one module each, found by name."""

from integ_gym.envs.discovery import Registry

ENGINES = Registry(__name__, "engine", "advance")
