"""Plants: one module each, found by name."""

from integ_gym.support import Registry

PLANTS = Registry(__name__, "plant", "acceleration")
