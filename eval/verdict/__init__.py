"""Verdicts: which wins are physics and which are simulator artefacts.

Knows the rules and their margins; the numbers are the statistics'.
"""
