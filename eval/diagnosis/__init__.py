"""Diagnosis of integrators on plants: measured, expected, and whether it holds.

Knows theory and the numerics' measurements; says what holds at the given steps.
"""
