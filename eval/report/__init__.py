"""What people see of a panel: the page and the figures, from ``panel.json`` alone.

Nothing is computed here that ``panel.json`` does not hold.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .data import ordered_verdicts
    from .figures import STYLES, write_figures
    from .page import write_report
else:
    __getattr__, __dir__ = lazy_door(__name__)
