"""The atlas: one panel over many limits of the control, and a map of its outcomes.

Knows panels as they are specified and run; reads summaries, never their evidence.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .publishing import publish
    from .running import again, missing, run_blocks
    from .specification import Atlas, Block, read_atlas
    from .summaries import Agreement, read_summary
else:
    __getattr__, __dir__ = lazy_door(__name__)
