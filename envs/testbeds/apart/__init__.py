"""Tasks of libraries that run in a Python environment of their own, behind a process."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .tasks import DmControlTask, IsaaclabTask
else:
    __getattr__, __dir__ = lazy_door(__name__)
