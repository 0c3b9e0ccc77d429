"""An export as Parquet: the files as they are, with a Croissant description and a data card."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .dataset import changed_since_export, read_export, write_parquet
else:
    __getattr__, __dir__ = lazy_door(__name__)
