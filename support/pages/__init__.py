"""The frame of every page: its template, its sheet, its one script and its security policy.

Knows a page that opens offline, not what is shown on it.
"""

from typing import TYPE_CHECKING

from ..doors import lazy_door

if TYPE_CHECKING:
    from .frame import page_environment, page_parts
else:
    __getattr__, __dir__ = lazy_door(__name__)
