"""Evidence: one record per episode, with all that is needed to question a result."""

from integ_gym.evidence.context import EpisodeContext
from integ_gym.evidence.errors import BatchExistsError, EvidenceError
from integ_gym.evidence.fields import SCHEMA_VERSION
from integ_gym.evidence.json_schema import json_schema
from integ_gym.evidence.labels import EpisodeFacts, Replays, failure_label
from integ_gym.evidence.record import EvidenceRecord
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.store import EvidenceStore, Problem, open_run
from integ_gym.evidence.vector_recorder import RecordVectorEvidence

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
