"""Recorders: wrappers that keep evidence of every episode of an environment, single or vector.

Knows when an episode begins and ends.
"""
