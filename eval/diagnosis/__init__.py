"""Diagnosis of integrators on plants: measured, expected, and whether it holds."""
