"""Intervals and tests over training seeds, and over the episodes of one given policy.

Knows arrays of rates and returns, not what they are rates of.
"""
