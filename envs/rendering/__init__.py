"""Pictures of an episode: in a window, or as arrays.

Knows the geometry of plants, not how they move.
"""
