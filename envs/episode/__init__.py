"""One episode as pure functions: arguments, discretization, timing, starts, transition, `info`.

Knows a plant, a task and an engine put together, and nothing of Gymnasium's classes.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .control_period import (
        AWAY,
        DIVERGED,
        NOT_CONVERGED,
        NOT_REPORTED,
        OK,
        STATUS_NAMES,
        EnvState,
        Outcome,
        initial_state,
        quiet_status,
        sensed,
        top_speed,
        transition,
    )
    from .discretization import DISCRETIZATION, NATIVE, Discretization, agrees
    from .info import BLANK, LOSSES, reset_info, step_info
    from .lane_starts import Begun, LaneStarts
    from .mixture import WEIGHT, Mixture, make_mixture
    from .script import Script, script_of
    from .settings import Settings, Setup, build_setup
    from .starts import (
        MEMBER,
        NOISE,
        GivenNumbers,
        check_options,
        check_starts,
        checked_episodes,
        checked_state,
        draw_start,
        numbers_per_start,
        possible,
        stream_of_episode,
    )
    from .steps import (
        RESULTS,
        WARM_UP,
        LanesStep,
        ScalarStart,
        ScalarStep,
        plain_start,
        plain_step,
        traced_start,
        traced_step,
    )
    from .timing import Timing, check_divides, dividing_step, whole_multiple
else:
    __getattr__, __dir__ = lazy_door(__name__)
