"""The registered ids: their environments, with the contract of each in its docstring.

Knows which task goes with which defaults; adding an id is adding a file.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .lookup import (
        OTHER_TESTBEDS,
        OWN_ENVIRONMENT,
        environment_class,
        environment_mixture,
        environment_setup,
        is_integ_environment,
    )
    from .registration import ENVIRONMENTS, register_environments
else:
    __getattr__, __dir__ = lazy_door(__name__)
