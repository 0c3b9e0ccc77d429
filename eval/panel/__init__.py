"""The panel: what is asked, how it is run, and what came out.

Rooms in this order: specification, running, results; ``panel.json`` has its model here.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .answer import (
        Cause,
        Finding,
        NextStep,
        answer_lines,
        cause_of,
        closed_words,
        finding_of,
        next_step,
    )
    from .calls import evaluate, run_panel, specified, work_on_panel
    from .checking import against_plan, check_finished
    from .existing import acting_in, policy_of
    from .model import FILE_NAME, Estimate, Panel, Verdict, read_panel
    from .power import family_power
    from .running import MANIFEST, fixed_cost, policy_costs, read_manifest, total_cost
    from .sharing import rewriting
    from .specification import (
        BUILT_IN,
        TRAINERS,
        Home,
        PanelSpec,
        SpecError,
        grown,
        map_of,
        parse_spec,
        read_toml,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
