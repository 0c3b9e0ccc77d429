"""What is asked of an engine."""

from __future__ import annotations

from dataclasses import dataclass

from ..processes.workers import cores


class ClusterError(ValueError):
    """An engine that cannot be used, in one sentence with the remedy."""


@dataclass(frozen=True)
class Resources:
    """What is asked for.

    Attributes:
        workers: processes; None: as many as there is room for.
        cores: of each worker.
        gpus: of each worker.
        memory_gib: that all workers together may take; None: nothing is asked for.
    """

    workers: int | None = None
    cores: int = 1
    gpus: float = 0
    memory_gib: float | None = None

    def __post_init__(self) -> None:
        if self.cores < 1:
            raise ClusterError(f"a worker has 1 core or more, got {self.cores}")
        if not self.gpus >= 0:
            raise ClusterError(f"a worker has 0 GPUs or more, got {self.gpus}")

    @property
    def here(self) -> int:
        """Workers that this machine has room for, or that were asked for."""
        return self.workers or max(1, cores() // self.cores)
