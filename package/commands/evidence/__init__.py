"""``integ-gym evidence``: every one of its subcommands that is more than a call.

Knows arguments and terminals; records are the evidence floor's.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .command import main, parser
else:
    __getattr__, __dir__ = lazy_door(__name__)
