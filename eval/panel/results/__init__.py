"""What came out of a panel: evidence reduced to a matrix, judged, written as ``panel.json``.

Knows records and verdicts; how they are shown is the report's business.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .comparing import ROUNDING, Difference, differences
    from .ending import CHECKING, JUDGING, Begin, phases
    from .findings import paired_episodes
    from .given import compares_success, given_rows, home_cell
    from .layout import PanelLayout
    from .matrix import Matrix
    from .outputs import (
        artefact_of,
        call_of,
        cost_of,
        look_warnings,
        noted_call,
        of_plan,
        panel_of,
        reduced,
        seen_now,
        write_artefact,
        write_outputs,
    )
    from .rewards import reward_doubts
else:
    __getattr__, __dir__ = lazy_door(__name__)
