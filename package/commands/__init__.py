"""Every subcommand of ``integ-gym``, one module each, named as it is called.

Knows arguments and terminals; the work is done behind the other floors' doors.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from . import census, diagnose, engines, evaluate, evidence, panel, play, report, train, watch
else:
    __getattr__, __dir__ = lazy_door(__name__)
