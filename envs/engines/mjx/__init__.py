"""MJX: MuJoCo in JAX, its step a compiled function of numbers."""
