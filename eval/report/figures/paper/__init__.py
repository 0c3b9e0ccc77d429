"""A panel's figures as papers print them: column width, 8 pt, labelled axes, no titles.

The same descriptions as the page's figures, hence the same numbers and ticks.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .forest import print_forest
    from .ladders import print_ladders
    from .matrix import print_matrix
else:
    __getattr__, __dir__ = lazy_door(__name__)
