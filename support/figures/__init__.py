"""What all figures share: colours, markers, and how a figure is begun and written.

Knows pictures of numbers, not where the numbers come from.
"""

from typing import TYPE_CHECKING

from ..doors import lazy_door

if TYPE_CHECKING:
    from .colours import AMOUNTS, PALETTE, channels
    from .series import HUES
else:
    __getattr__, __dir__ = lazy_door(__name__)
