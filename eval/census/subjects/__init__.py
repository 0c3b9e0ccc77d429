"""What the census looks at: something that steps a pendulum or a cart-pole."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .engines import engine_subjects
    from .published import PUBLISHED
    from .settable import Settable
    from .subject import COAST, Sample, State, Statement, Subject, Transition
else:
    __getattr__, __dir__ = lazy_door(__name__)
