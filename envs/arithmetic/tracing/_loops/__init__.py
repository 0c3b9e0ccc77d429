"""Loops over lanes that Numba compiles."""
