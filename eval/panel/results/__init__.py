"""What came out of a panel: evidence reduced to a matrix, judged, written as ``panel.json``.

Knows records and verdicts; how they are shown is the report's business.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .matrix import Matrix, Row
    from .outputs import cost_of, reduced, write_artefact, write_outputs
    from .paired import paired_episodes, paired_remark
else:
    __getattr__, __dir__ = lazy_door(__name__)
