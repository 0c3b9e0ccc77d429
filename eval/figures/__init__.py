"""Figures of a panel as files."""

from integ_gym.eval.figures.write import write_figures

__all__ = ["write_figures"]
