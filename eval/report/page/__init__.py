"""The report of a panel: one HTML file that opens offline and needs nothing beside it."""

from .page import render, write_report

__all__ = ["render", "write_report"]
