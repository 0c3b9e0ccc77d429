"""One episode as pure functions: arguments, discretization, timing, starts, transition, `info`.

Knows a plant, a task and an engine put together, and nothing of Gymnasium's classes.
"""
