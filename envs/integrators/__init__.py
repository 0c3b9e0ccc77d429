"""Integrators: one module each, found by name."""

from integ_gym.support import Registry

INTEGRATORS = Registry(__name__, "integrator", "step")
