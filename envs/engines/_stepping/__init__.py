"""What all engines share: the control period, its steps, and calls that leave the process alone."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .foreign import ASTRAY, ForeignEngine, Run, guarded, is_astray
    from .mapped import MappedEngine, lacks_integrator, refuse_arrays
    from .stepped import CONSTRAINT_VIOLATION, SteppedEngine
    from .undisturbed import load_undisturbed, quiet
else:
    __getattr__, __dir__ = lazy_door(__name__)
