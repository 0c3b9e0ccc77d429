"""Records taken to the formats of other tools: tables, data sets of episodes, logs of robots.

Knows records and formats; what a format cannot hold is left out and counted, or refused.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .exporting import EXPORT_FORMATS, TEXT_FORMATS, Exported, export
    from .parquet_dataset import changed_since_export, read_export
else:
    __getattr__, __dir__ = lazy_door(__name__)
