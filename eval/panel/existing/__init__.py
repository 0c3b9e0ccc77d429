"""A policy that exists already: read, with what is known of its training, and planned around.

An evaluation is a panel without training.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .evaluate import evaluate_existing
    from .facts import given_panel, other_facts
    from .given import given_policy, is_reference
    from .planning import plan
    from .policy import hashes_of, kept_policy, read_existing, read_policy_file
    from .run_policies import acting_in, policy_of
else:
    __getattr__, __dir__ = lazy_door(__name__)
