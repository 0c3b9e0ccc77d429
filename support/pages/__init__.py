"""What every page is made with: one file that opens offline and loads nothing.

Knows templates and styles, not what a page is about.
"""

from typing import TYPE_CHECKING

from ..doors import lazy_door

if TYPE_CHECKING:
    from .page import page_environment, page_parts
else:
    __getattr__, __dir__ = lazy_door(__name__)
