"""A panel run: training and evaluation in units of work, resumable, each made visible at once.

Knows the specification and the run's directory; results are reduced elsewhere.
"""
