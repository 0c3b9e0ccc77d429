"""Plants: continuous-time systems, one module each, found by name.

A plant gives accelerations, energy and losses; it knows no integrator and no task.
"""
