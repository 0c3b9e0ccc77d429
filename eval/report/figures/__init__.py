"""Figures of a panel, one module each."""
