"""Playing: somebody drives a plant by hand and changes its discretization while it moves.

Knows environments and windows, no policies and no records.
"""
