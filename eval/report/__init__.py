"""The report of a panel: one HTML file that opens offline and needs nothing beside it."""

from integ_gym.eval.report.page import render, write_report

__all__ = ["render", "write_report"]
