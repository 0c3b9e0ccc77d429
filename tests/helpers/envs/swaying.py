"""The monoped, and an episode of it that is recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.record import EvidenceRecord
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence

MONOPED = "examples.robots.monoped:Monoped"


def record_swaying(environments: Any, folder: Path, decisions: int) -> tuple[str, EvidenceRecord]:
    """One lane that sways for so many decisions, which end its episode: the file and the record."""
    context = EpisodeContext("run", "cell", policy_id="sway")
    recorder = RecordVectorEvidence(environments, folder, context)
    observation, _ = recorder.reset(seed=[4])
    for _ in range(decisions):
        observation, *_ = recorder.step(0.3 * np.tanh(observation[:, 10:13], dtype=np.float32))
    recorder.close()
    ((file, record),) = EvidenceStore(folder).named_records()
    return file, record
