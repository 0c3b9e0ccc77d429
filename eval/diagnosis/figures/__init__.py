"""Figures of a diagnosis and of the worked example, drawn from their data alone."""
