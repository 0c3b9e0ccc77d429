"""The page: one HTML file that opens offline, one module for each part."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .page import render, write_report
else:
    __getattr__, __dir__ = lazy_door(__name__)
