"""Any Gymnasium environment, in a discretization that whoever made it states.

Knows what Gymnasium asks of an environment, and no more: state, energy and solver stay unknown.
"""
