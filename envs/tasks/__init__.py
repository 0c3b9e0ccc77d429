"""Tasks: what is asked of a plant, one module each, found by name.

A task gives starts, observations, rewards, termination and success; it knows no integrator, engine
or environment.
"""
