"""Diagnosis of integrators on plants: measured, expected, and whether it holds.

Knows theory and the numerics' measurements; says what holds at the given steps.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .page import DIAGNOSIS_PAGE
    from .run import Request, diagnose
    from .terminal import print_diagnosis
    from .worked_example import drift_example
else:
    __getattr__, __dir__ = lazy_door(__name__)
