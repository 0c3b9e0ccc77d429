"""The environments: plants, integrators and engines, and the tasks asked of them.

This floor knows the discrete map that a policy meets and how to step, draw and measure it. It knows
nothing of evidence, training or panels.
"""
