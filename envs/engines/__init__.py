"""Engines: what advances a plant through one control period, a file each; none knows a task."""
