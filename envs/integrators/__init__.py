"""Integrators: one-step maps of any plant, one module each, found by name.

An integrator knows what a system gives it and no plant by name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from integ_gym.support import Registry, lazy_door

if TYPE_CHECKING:
    from ._theory import LinearTheory
    from .implicit_euler import ImplicitEuler
    from .interface import Integrator, State, Step, System, along
else:
    __getattr__, __dir__ = lazy_door(__name__)


INTEGRATORS = Registry(__name__, "integrator", "step")

TRUTH = "reference"
"""The integrator that solves a plant to rounding."""
