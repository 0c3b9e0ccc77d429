"""Work shared between processes and machines: an engine that runs it, or claims in one directory.

Knows tasks and units by name, and nothing of what they do.
"""

from typing import TYPE_CHECKING

from ..doors import lazy_door

if TYPE_CHECKING:
    from .claims import (
        BLOCK,
        LEASE,
        Claim,
        ClaimError,
        Claims,
        close_units,
        is_fence,
        was_committed,
    )
    from .clusters import EXECUTORS, Cluster, cluster_of
    from .folder_files import FolderFiles, Gone, SharedFiles
    from .holding import held, pauses
    from .probing import PROBE, check_sharing
    from .resources import ClusterError, Resources
else:
    __getattr__, __dir__ = lazy_door(__name__)
