"""What integrators solve on the way: Newton's method, linear systems, kinks, an embedded pair.

Knows equations over components, not which integrator asks.
"""
