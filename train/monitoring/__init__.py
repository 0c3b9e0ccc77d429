"""Overfitting to the discretization watched while it happens, in other people's training.

Measures a policy's return and success at home and elsewhere; verdicts are panels' business.
"""
