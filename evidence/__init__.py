"""Evidence: one record per episode, with all that is needed to question a result."""

from .episodes import EpisodeContext
from .schema import BatchExistsError, EvidenceError
from .schema import SCHEMA_VERSION
from .schema import json_schema
from .episodes import EpisodeFacts, Replays, failure_label
from .episodes import EvidenceRecord
from .recorders import RecordEvidence
from .store import EvidenceStore, Problem, open_run
from .recorders import RecordVectorEvidence

__all__ = [
    "SCHEMA_VERSION",
    "BatchExistsError",
    "EpisodeContext",
    "EpisodeFacts",
    "EvidenceError",
    "EvidenceRecord",
    "EvidenceStore",
    "Problem",
    "RecordEvidence",
    "RecordVectorEvidence",
    "Replays",
    "failure_label",
    "json_schema",
    "open_run",
]
