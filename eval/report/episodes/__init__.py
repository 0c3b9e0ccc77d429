"""Single episodes for the page: every outcome, some traces, the picture of the task; packed."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .choice import chosen_words
    from .packing import packed
    from .task import TaskWords, task_words
    from .told import Told, told_by
else:
    __getattr__, __dir__ = lazy_door(__name__)
