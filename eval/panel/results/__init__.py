"""What came out of a panel: evidence reduced to a matrix, judged, written as ``panel.json``.

Knows records and verdicts; how they are shown is the report's business.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .artefact import build_artefact
    from .matrix import Matrix, Row
    from .outputs import (
        evaluation_records,
        facts_of,
        make_layout,
        shares_of,
        write_artefact,
        write_outputs,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
