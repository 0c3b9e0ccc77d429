"""Engines: what advances a plant through one control period, one module or folder each.

The native engine runs our integrators; the others are simulators that are told the same plant. An
engine knows plants and maps, and no task.
"""
