"""The arithmetic that physics is written in: floats, NumPy arrays, JAX arrays and symbols.

Knows numbers alone. Everything that computes with a plant's state is written against `Ops`.
"""
