"""Evaluation: panels, atlas, statistics, verdicts, reports, films; diagnosis; census; play.

The floor that judges. It knows testbeds, policies and evidence through their doors.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .atlas import (
        Agreement,
        Atlas,
        Block,
        again,
        missing,
        publish,
        read_atlas,
        read_summary,
        run_blocks,
    )
    from .census import PUBLISHED, render_census, row, take_census
    from .diagnosis import DIAGNOSIS_PAGE, Request, diagnose, drift_example, print_diagnosis
    from .film import Film, candidates, check_writable, show_film, side_by_side, watch
    from .loss_check import Check, CheckedCell, check
    from .panel import (
        BUILT_IN,
        FILE_NAME,
        MANIFEST,
        TRAINERS,
        Estimate,
        Panel,
        PanelSpec,
        Verdict,
        acting_in,
        against_plan,
        answer_lines,
        check_finished,
        evaluate,
        family_power,
        fixed_cost,
        grown,
        next_step,
        policy_costs,
        policy_of,
        read_panel,
        rewriting,
        run_panel,
        specified,
        total_cost,
        work_on_panel,
    )
    from .playing import Game, play_in_window
    from .report import STYLES, ordered_verdicts, write_figures, write_report
else:
    __getattr__, __dir__ = lazy_door(__name__)
