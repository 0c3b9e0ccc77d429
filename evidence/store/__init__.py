"""The store: Parquet files of records, each one batch, with what reads and prints them.

Knows files and queries, not how records came about.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .elsewhere import query_in_place
    from .merging import Merged, merge
    from .parquet_file import check_schema, parts, read
    from .printing import TABLE_FORMATS, print_table
    from .showing import ASCII_BARS, BARS, show
    from .store import EvidenceStore, open_run
else:
    __getattr__, __dir__ = lazy_door(__name__)
