"""Processes and the machine that they run on: workers, what can be sent to them, locks, cores.

Knows functions that are called elsewhere, and nothing of what they do.
"""
