"""Testbeds: tasks that can be made in any discretization, which panels and trainers know alone.

integ-gym's own environments and Gymnasium's MuJoCo tasks; `testbed_of` finds the one of an
environment id.
"""

from .finding import testbed_of
from .interface import Applied, Success, Testbed
from .making import make_checked, make_training_environments

__all__ = [
    "Applied",
    "Success",
    "Testbed",
    "make_checked",
    "make_training_environments",
    "testbed_of",
]
