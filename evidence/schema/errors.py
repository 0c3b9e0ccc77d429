"""What can go wrong with evidence that is read or written, and what a check of it finds."""

from __future__ import annotations

from dataclasses import dataclass

from integ_gym.support.terminal import visible


class EvidenceError(ValueError):
    """One sentence that says what is wrong with the evidence and what helps."""


class BatchExistsError(EvidenceError):
    """A batch of that name has already been committed."""


@dataclass(frozen=True)
class Finding:
    """One thing that is not as it should be.

    Attributes:
        file: where, relative to the run.
        record_id: the record, or None if more than one is meant.
        message: what is wrong.
    """

    file: str
    record_id: str | None
    message: str

    def __str__(self) -> str:
        where = self.file if self.record_id is None else f"{self.file}: {self.record_id}"
        return visible(f"{where}: {self.message}")
