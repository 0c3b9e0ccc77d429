"""What records say, held against their traces, the same episodes played again, and the seal.

Knows episodes and environments; plans and policies are of higher floors.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .gaps import missing_episodes, other_columns
    from .recomputing import recompute
    from .replaying import ELSEWHERE, Acting, Replayed, replay
    from .sampling import replay_some
    from .sealing import (
        SEAL_FILE,
        SIGNATURE_FILE,
        broken_seals,
        lift_seal,
        lower_seal,
        read_seal,
        seal,
        unbroken_seal,
    )
    from .signing import broken_signature, can_check_signatures, check_key, sign, signer_of
else:
    __getattr__, __dir__ = lazy_door(__name__)
