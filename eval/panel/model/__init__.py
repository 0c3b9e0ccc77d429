"""The typed model of ``panel.json``: written, read and published as JSON Schema from here alone.

Knows what a finished panel says, not how it came about or how it is drawn.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .conclusions import (
        CellFinding,
        EngineAgreement,
        Failure,
        Median,
        PairedEpisodes,
        PolicyComparison,
        RankingAgreement,
        Remedy,
        RemedyCell,
        RemedyLoss,
        TrainingCost,
        Verdict,
    )
    from .files import FILE_NAME, read_panel, write_panel
    from .matrix import AppliedDiscretization, Cell, Entry, Policy, Row, RowKind
    from .panel import Cost, Group, Look, Panel
    from .part import Estimate, build
else:
    __getattr__, __dir__ = lazy_door(__name__)
