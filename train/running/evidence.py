"""Where the episodes of a training run are recorded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from integ_gym.evidence.episodes.context import EpisodeContext
from integ_gym.evidence.recorders.vector_recorder import RecordVectorEvidence
from integ_gym.evidence.store.store import EvidenceStore


@dataclass(frozen=True)
class TrainingEvidence:
    """Where the training episodes of one policy are recorded, and what is said about them.

    Attributes:
        store: directory of an `EvidenceStore`.
        batch: name of the batch that holds them.
        context: what they are for; the fleet sets its float width and adds its packages.
    """

    store: Path
    batch: str
    context: EpisodeContext

    def recorder(self, vector_env: Any) -> Any:
        """Training environments that record; ``commit(batch)`` writes what they have recorded."""
        store = EvidenceStore(self.store)
        return RecordVectorEvidence(vector_env, store, self.context, commit_on_close=False)

    def discard(self) -> None:
        """Remove what a worker wrote that was lost before the run was finished."""
        (self.store / f"{self.batch}.parquet").unlink(missing_ok=True)
