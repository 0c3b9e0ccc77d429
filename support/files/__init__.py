"""Files: written whole or not at all, and read within bounds.

Knows bytes and JSON, not what they say.
"""

from typing import TYPE_CHECKING

from ..doors import lazy_door

if TYPE_CHECKING:
    from .reading import (
        Kinds,
        check_regular,
        checked_object,
        parse_json,
        read_bounded,
        read_json,
        read_object,
    )
    from .writing import (
        cannot_write,
        file_hash,
        make_folder,
        new_path,
        remove_leftovers,
        replace_file,
        told_path,
        write_json,
        write_once,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
