"""Files that appear whole or not at all, and the folder of ``--out``.

Knows bytes and paths, not what is in them.
"""

from typing import TYPE_CHECKING

from ..doors import lazy_door

if TYPE_CHECKING:
    from .atomic import remove_leftovers, replace_file, write_json, write_once
    from .output_folder import cannot_write, make_folder
else:
    __getattr__, __dir__ = lazy_door(__name__)
