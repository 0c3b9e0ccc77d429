"""Recorders: wrappers that keep evidence of every episode of an environment, single or vector.

Knows when an episode begins and ends.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .recorder import RecordEvidence
    from .recording import now
    from .vector_recorder import RecordVectorEvidence
else:
    __getattr__, __dir__ = lazy_door(__name__)
