"""Rows and cells: discretizations, mixtures and engines, perturbations and sweeps.

Knows single cells and rows, not the panel that they are of.
"""
