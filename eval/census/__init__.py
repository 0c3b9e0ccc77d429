"""A census: which one-step map each pendulum and cart-pole of a name really is.

Knows published environments and engines from outside, by their states.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .page import render_census
    from .run import take_census
    from .subjects import PUBLISHED
    from .words import row
else:
    __getattr__, __dir__ = lazy_door(__name__)
