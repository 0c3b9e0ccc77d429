"""The bench: who is examined, and how motions are followed on it, each leaving evidence."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .bench import Bench, Commands
    from .handmade import success_lines
    from .impact import PHASES, Impact, impact_of
    from .integrators import check_integrator, theory_of
    from .rollout import Array, Rollout
    from .subject import RELEASE, Subject, subjects
else:
    __getattr__, __dir__ = lazy_door(__name__)
