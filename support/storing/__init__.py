"""Where a run's files are kept: a folder that all see, or a bucket of an object store.

Knows names and bytes, and how one of many can be sure to be the only one.
"""

from typing import TYPE_CHECKING

from ..doors import lazy_door

if TYPE_CHECKING:
    from .bucket import BucketStorage
    from .objects import StorageError, opened_store, parquet_files
    from .places import Place, as_storage, fetched, is_remote, named_place, stored
    from .storage import Busy, FolderStorage, Storage
else:
    __getattr__, __dir__ = lazy_door(__name__)
