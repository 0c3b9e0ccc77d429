"""Hand-made controllers, a module for each task.

Each knows its task's plant and parameters, not its discretization.
"""
