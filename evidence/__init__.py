"""Evidence: one record per episode, with all that is needed to question a result.

This floor knows environments and what they tell, and nothing of how policies are trained or judged.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .episodes import (
        EpisodeContext,
        EpisodeHead,
        EpisodeHeads,
        EpisodeLog,
        EvidenceRecord,
        Home,
        Layout,
        Replays,
        argument_values,
        plain,
        record_table,
        told_json,
        told_perturbation,
        told_training,
        unhashed_table,
    )
    from .exchange import (
        EXPORT_FORMATS,
        TEXT_FORMATS,
        Exported,
        changed_since_export,
        export,
        read_export,
    )
    from .recorders import RecordEvidence, RecordVectorEvidence, now
    from .schema import (
        ATTEMPT,
        LATER_ATTEMPT,
        SCHEMA_VERSION,
        SECOND_HORIZON,
        EvidenceError,
        Finding,
    )
    from .store import (
        ASCII_BARS,
        BARS,
        TABLE_FORMATS,
        EvidenceStore,
        merge,
        open_run,
        print_table,
        query_in_place,
        show,
    )
    from .verification import (
        ELSEWHERE,
        SEAL_FILE,
        SIGNATURE_FILE,
        Acting,
        Replayed,
        broken_seals,
        broken_signature,
        can_check_signatures,
        check_key,
        lift_seal,
        lower_seal,
        missing_episodes,
        other_columns,
        read_seal,
        recompute,
        replay,
        replay_some,
        seal,
        sign,
        signer_of,
        unbroken_seal,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
