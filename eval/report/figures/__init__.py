"""Figures of a panel as files."""

from .write import write_figures

__all__ = ["write_figures"]
