"""Episodes on their way to records: what is said about them, their rows, labels and summaries.

Knows one episode or many at once; files are the store's.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .attribution import ReplayLookups, SetupOfLane
    from .context import EpisodeContext
    from .decisions import choices, told_setup
    from .episode_log import EpisodeHead, EpisodeHeads, EpisodeLog
    from .labels import EpisodeFacts, Home, Replays, failure_label, lacks_home
    from .layout import Layout
    from .record import (
        EvidenceRecord,
        argument_values,
        plain,
        records_of,
        told_arguments,
        told_engine,
        told_json,
        told_perturbation,
        told_training,
    )
    from .table import record_table, unhashed_table
else:
    __getattr__, __dir__ = lazy_door(__name__)
