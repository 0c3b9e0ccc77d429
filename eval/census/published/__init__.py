"""Published environments called pendulum or cart-pole: one module for each library."""

from integ_gym.envs.discovery import Registry

PUBLISHED = Registry(__name__, "published library", "subjects")
